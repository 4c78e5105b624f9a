# SPDX-License-Identifier: Apache-2.0
# cmake -DOUTPUT=FILE -DINPUTS=A,B,... -P idl_files.cmake: the files as {"NAME", R"IDL(TEXT)IDL"}, lines.
string(REPLACE "," ";" inputs "${INPUTS}")
set(all "")
foreach(file ${inputs})
  get_filename_component(name ${file} NAME)
  file(READ ${file} text)
  string(APPEND all "{\"${name}\", R\"IDL(${text})IDL\"},\n")
endforeach()
file(WRITE ${OUTPUT} "${all}")
