// Messages of the library with the words of Python: "--no-feedthrough" becomes "feedthrough=False".
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace tokid::python {

std::string in_python(std::string text);
std::vector<std::string> in_python(std::vector<std::string> texts);

}  // namespace tokid::python
