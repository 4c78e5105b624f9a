# The web server: page, API and live messages on one port. What it serves comes from elsewhere, by functions and a Hub.
add_library(citylearn_web_server STATIC
  access.cc
  client_hub.cc
  connections.cc
  runs_feed.cc
  page.cc
  server.cc
  session.cc
  target.cc)
target_link_libraries(citylearn_web_server
  PUBLIC citylearn_dashboard
  PRIVATE citylearn_warnings Boost::headers OpenSSL::SSL OpenSSL::Crypto Threads::Threads)
if(CMAKE_CXX_FLAGS MATCHES "undefined")
  # Coroutines over Beast's templates, checked at each access, take the compiler 3 GB and ten minutes.
  set_source_files_properties(session.cc PROPERTIES COMPILE_OPTIONS -fno-sanitize=undefined)
endif()
if(CMAKE_CXX_FLAGS MATCHES "sanitize=thread" AND CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  # Asio's fences, of which ThreadSanitizer knows nothing. What is handed from thread to thread there has locks too.
  target_compile_options(citylearn_web_server PUBLIC -Wno-tsan)
endif()

add_executable(dashboard main.cc playback.cc)
target_link_libraries(dashboard PRIVATE citylearn_web_server citylearn_recording citylearn_warnings)
