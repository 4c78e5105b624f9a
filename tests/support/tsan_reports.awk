# Reports of ThreadSanitizer that count: awk -f tsan_reports.awk FILE ... prints them.
#
# Left out are races between two accesses that both lie in one of these libraries, which are not instrumented and hand
# memory from thread to thread by atomics: only their calls of the C library (malloc, memcpy, lock) are seen, nothing of
# what keeps them apart. Where our code makes one of the accesses, the report counts.
BEGIN { foreign = "\\((libddsc|libopencv_dnn|libopencv_core|libavcodec|libavutil)\\.so" }

# The report read so far, if it counts.
function tell() { if (text != "" && !(race && accesses == 2 && elsewhere == 2)) printf "%s", text }

/^WARNING: / {
  tell()
  text = ""; race = /data race/; accesses = elsewhere = open = 0
}
text != "" || /^WARNING: / { text = text $0 "\n" }
/^  (Previous )?([Aa]tomic )?([Ww]rite|[Rr]ead) of size/ { open = 1; ++accesses; next }
# Of an access whose stack is lost the other one tells.
open && /\[failed to restore the stack\]/ { open = 0; ++elsewhere; next }
# The innermost frame that is not the sanitizer's own tells who made the access.
open && /^    #/ && !/\(libtsan/ { open = 0; elsewhere += $0 ~ foreign; next }
/^$/ { open = 0 }
END { tell() }
