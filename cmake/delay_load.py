# SPDX-License-Identifier: Apache-2.0
"""Prints C++ with a stub for each function of shared libraries that an archive calls: NM READELF ARCHIVE LIBRARY...

A stub jumps to its function; before the first call, core/plugin/delay_load.cc loads the library.
"""

import subprocess
import sys

RESOLVE = """// SPDX-License-Identifier: Apache-2.0
// Made by cmake/delay_load.py.
asm(R"(
.text
resolve:  # keeps the registers that may hold arguments; %r11, which may hold none, names the function
  push %rax; push %rdi; push %rsi; push %rdx; push %rcx; push %r8; push %r9
  sub $128, %rsp
  .irp n, 0, 1, 2, 3, 4, 5, 6, 7
  movaps %xmm\\n, 16 * \\n(%rsp)
  .endr
  mov %r11, %rdi; mov 8(%r11), %rsi; mov 16(%r11), %rdx
  call citylearn_load_function
  mov %rax, %r11
  .irp n, 0, 1, 2, 3, 4, 5, 6, 7
  movaps 16 * \\n(%rsp), %xmm\\n
  .endr
  add $128, %rsp
  pop %r9; pop %r8; pop %rcx; pop %rdx; pop %rsi; pop %rdi; pop %rax
  jmp *%r11
"""
STUB = """
.globl {function}
.hidden {function}
.type {function}, @function
{function}: jmp *1f(%rip)
2: lea 1f(%rip), %r11
  jmp resolve
.pushsection .data
1: .quad 2b, 3f, 4f
.popsection
.pushsection .rodata
3: .asciz "{library}"
4: .asciz "{function}"
.popsection
"""


def read(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


def main(nm, readelf, archive, *libraries):
    called = {line.split()[-1] for line in read(nm, "-u", archive) if line.startswith(" ")}
    print(RESOLVE)
    for library in libraries:
        name = next(line for line in read(readelf, "-d", library) if "(SONAME)" in line).split("[")[1].rstrip("]")
        for _, kind, symbol in map(str.split, read(nm, "-D", "--defined-only", library)):
            function = symbol.split("@")[0]
            if kind == "T" and function in called:
                print(STUB.format(library=name, function=function))
    print(')");')


main(*sys.argv[1:])
