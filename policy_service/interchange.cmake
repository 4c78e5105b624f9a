# Formats that others read. ONNX exporters register themselves by a static object: link the library whole.
add_library(citylearn_interchange STATIC
  interchange/agent_graph.cc
  interchange/event_log.cc
  interchange/export.cc
  interchange/exporters/baseline.cc
  interchange/exporters/features.cc
  interchange/exporters/place_filter.cc
  interchange/exporters/place_memory.cc
  interchange/exporters/raw_images.cc
  interchange/onnx_graph.cc
  interchange/safetensors.cc)
target_link_libraries(citylearn_interchange
  PUBLIC "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>"
  PRIVATE citylearn_warnings onnx_proto)
