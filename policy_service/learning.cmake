# Networks and learners register themselves by a static object: link the library whole,
# $<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>.
add_library(citylearn_learning STATIC
  agent_network.cc
  checkpoint.cc
  collector.cc
  learners/descent.cc
  learners/ppo.cc
  learners/relabel.cc
  learners/vtrace.cc
  network_policy.cc
  networks/baseline.cc
  networks/features.cc
  networks/lstm.cc
  networks/parts.cc
  networks/place_filter.cc
  networks/place_memory.cc
  networks/raw_images.cc
  parameter_chunks.cc
  rollout.cc
  trainer.cc
  trajectories.cc)
# Eigen shall start no threads of its own: halves of the work are given to two threads here, and results must not vary.
target_compile_definitions(citylearn_learning PUBLIC EIGEN_DONT_PARALLELIZE)
target_link_libraries(citylearn_learning
  PUBLIC citylearn_core Eigen3::Eigen nlohmann_json::nlohmann_json
  PRIVATE citylearn_warnings OpenSSL::Crypto Threads::Threads)
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  target_compile_options(citylearn_learning PUBLIC -Wno-uninitialized)  # false alarms on AVX-512 (GCC bug 105593)
endif()
