// The style sheets and scripts of the pages, which the build embeds into the library (cmake/embed.cmake).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>

namespace tokid::report::assets {

std::string_view page_css();
std::string_view page_js();
std::string_view paper_js();
std::string_view plots_js();
std::string_view report_js();
std::string_view uplot_css();
std::string_view uplot_js();
std::string_view uplot_license();

}  // namespace tokid::report::assets
