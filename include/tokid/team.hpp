// Several processes that share one piece of work.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// One process alone by default.
struct Team {
  Index rank = 0, size = 1;
  // What the first member says, at all of them; and what each of them says in turn, at the first one.
  std::function<std::string(std::string)> broadcast = [](const std::string& own) { return own; };
  std::function<std::vector<std::string>(std::string)> gather = [](const std::string& own) {
    return std::vector<std::string>{own};
  };
};

}  // namespace tokid
