# SPDX-License-Identifier: Apache-2.0
# libtorch's own TorchConfig.cmake asks for much that a program against it never needs, and Debian's for files of other packages.
# Looks where the packages put it, and below LibTorch_ROOT (the unpacked archive of pytorch.org, of the cxx11 ABI).
find_path(LibTorch_INCLUDE_DIR torch/library.h)
find_path(LibTorch_API_INCLUDE_DIR torch/torch.h PATH_SUFFIXES torch/csrc/api/include)
set(libraries "")
foreach(name torch torch_cpu c10)
  find_library(LibTorch_${name}_LIBRARY ${name})
  list(APPEND libraries LibTorch_${name}_LIBRARY)
endforeach()
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LibTorch REQUIRED_VARS LibTorch_torch_LIBRARY LibTorch_torch_cpu_LIBRARY
  LibTorch_c10_LIBRARY LibTorch_INCLUDE_DIR LibTorch_API_INCLUDE_DIR)
if(LibTorch_FOUND AND NOT TARGET LibTorch::LibTorch)
  add_library(LibTorch::LibTorch INTERFACE IMPORTED)
  target_include_directories(LibTorch::LibTorch SYSTEM INTERFACE ${LibTorch_INCLUDE_DIR} ${LibTorch_API_INCLUDE_DIR})
  # Without its own symbols in use (all are in torch_cpu) libtorch.so would be dropped, and CUDA with it.
  target_link_libraries(LibTorch::LibTorch INTERFACE "-Wl,--push-state,--no-as-needed" ${LibTorch_torch_LIBRARY} "-Wl,--pop-state"
    ${LibTorch_torch_cpu_LIBRARY} ${LibTorch_c10_LIBRARY})
endif()
mark_as_advanced(LibTorch_INCLUDE_DIR LibTorch_API_INCLUDE_DIR ${libraries})
