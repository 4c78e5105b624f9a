# SPDX-License-Identifier: Apache-2.0
# Reports of ThreadSanitizer that count: awk -f tsan_reports.awk FILE ... prints them.
#
# Left out are those all of whose accesses (races) or locks (potential deadlocks) are made by one of these libraries.
# They are not instrumented: of what keeps their threads apart only calls of the C library are seen. Where our code makes
# one of them, the report counts.
BEGIN { foreign = "\\((libddsc|libdds_security_[a-z]+|libcrypto|libfastrtps|libfastdds|libgdal|libopencv_dnn|libopencv_core|libavcodec|libavutil)\\.so" }

# The report read so far, if it counts.
function tell() { if (text != "" && !(made > 1 && elsewhere == made)) printf "%s", text }

/^WARNING: / { tell(); text = ""; made = elsewhere = open = 0 }
text != "" || /^WARNING: / { text = text $0 "\n" }
/^  (Previous )?([Aa]tomic )?([Ww]rite|[Rr]ead) of size/ || /^  Mutex .* acquired here/ { open = 1; ++made; next }
# Of an access whose stack is lost the other one tells.
open && /\[failed to restore the stack\]/ { open = 0; ++elsewhere; next }
# The innermost frame that is not the sanitizer's own, nor the C++ library's, tells who made it.
open && /^    #/ && !/\((libtsan|libstdc\+\+)|\/usr\/include\/c\+\+\// { open = 0; elsewhere += $0 ~ foreign; next }
/^$/ { open = 0 }
END { tell() }
