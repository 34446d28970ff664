// A team: several processes that share one piece of work.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// The default is a team of one process.
struct Team {
  Index rank = 0, size = 1;
  // broadcast: every member gets the text of the first member. gather: the first member gets the texts of all members,
  // in order.
  std::function<std::string(std::string)> broadcast = [](const std::string& own) { return own; };
  std::function<std::vector<std::string>(std::string)> gather = [](const std::string& own) {
    return std::vector<std::string>{own};
  };
};

}  // namespace tokid
