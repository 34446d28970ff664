// The names of the choices about feedthrough, and their reasons in words.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "tokid/options.hpp"

namespace tokid {

const char* to_string(FeedthroughChoice::Reason reason) {
  static constexpr const char* names[] = {"stated", "exact", "no_response", "response", "feedback", "untested", "unknown"};
  return names[size_t(reason)];
}

std::string in_words(const FeedthroughChoice& choice) {
  using Reason = FeedthroughChoice::Reason;
  const auto because = [&]() -> std::string {
    switch (choice.reason) {
      case Reason::stated:
        return "as asked";
      case Reason::exact:
        return "exact in data without noise";
      case Reason::no_response:
        return "no response of the outputs to the inputs of the same step found";
      case Reason::response:
        return "the outputs respond to the inputs of the same step";
      case Reason::feedback:
        return "the outputs and inputs of a step are correlated, by feedthrough or by feedback within the step";
      case Reason::unknown:
        return "nothing is known of the choice";
      default:
        return "the samples do not tell whether it is zero";
    }
  };
  return fmt::format("{}, {}", choice.present ? "D is estimated" : "D = 0", because());
}

}  // namespace tokid
