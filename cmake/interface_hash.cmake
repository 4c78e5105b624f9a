# SPDX-License-Identifier: Apache-2.0
# cmake -DOUTPUT=FILE -DINPUTS=A,B,... -DALSO=TEXT -P interface_hash.cmake: writes a header with one hash of the files' contents.
string(REPLACE "," ";" inputs "${INPUTS}")
set(all "${ALSO}")
foreach(file ${inputs})
  file(SHA256 ${file} hash)
  string(APPEND all " ${hash}")
endforeach()
string(SHA256 hash "${all}")
string(SUBSTRING ${hash} 0 12 hash)
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT "#pragma once\n#define CITYLEARN_INTERFACE \"${hash}\"\n")
