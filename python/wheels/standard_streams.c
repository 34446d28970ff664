// Debian compiles its static libmatio for programs, not for shared libraries: on x86_64 it takes stdout and stderr for
// variables of the binary that it is linked into. They are defined here and hold what those of the C library hold.
// SPDX-License-Identifier: BSD-3-Clause
struct _IO_FILE_plus;
extern struct _IO_FILE_plus _IO_2_1_stdout_, _IO_2_1_stderr_;
__attribute__((visibility("hidden"))) struct _IO_FILE_plus* stdout = &_IO_2_1_stdout_;
__attribute__((visibility("hidden"))) struct _IO_FILE_plus* stderr = &_IO_2_1_stderr_;
