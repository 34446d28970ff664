#!/bin/sh
# The tool under valgrind: exits with 99 where memory is read before it is written, used after it is freed, or lost.
exec valgrind --quiet --error-exitcode=99 --leak-check=full --errors-for-leak-kinds=definite --num-callers=20 \
  "${TOKID_UNDER_VALGRIND:?}" "$@"
