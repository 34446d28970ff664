// SPDX-License-Identifier: BSD-3-Clause
#include "weights.hpp"

#include <limits>
#include <optional>

#include "common.hpp"

namespace tokid::app {

namespace {

std::optional<Weights> parse(const std::string& text, double smallest) {
  Weights values;
  for (const std::string& part : split_at_commas(text)) {
    const auto value = parse_number(part, smallest, std::numeric_limits<double>::max());
    if (!value) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

}  // namespace

void add_weights(Command& command, const char* option, Weights& target, const char* description) {
  command.value(
      option, target, "W,...", description, [](const std::string& text) { return parse(text, 0.0); },
      "numbers from 0 on needed, such as 2 or 0.5,2");
}

void add_limits(Command& command, const char* option, Weights& target, const char* description) {
  command.value(
      option, target, "U,...", description,
      [](const std::string& text) { return parse(text, std::numeric_limits<double>::lowest()); },
      "numbers needed, such as -2 or -2,0.5");
}

Matrix diagonal(const char* option, const Weights& weights, Index channels) {
  if (weights.size() == 1) return weights[0] * Matrix::Identity(channels, channels);
  if (Index(weights.size()) != channels)
    throw std::invalid_argument(fmt::format("{}: {} numbers found, one for all channels, or one for each of {} needed",
                                            option, weights.size(), channels));
  return Eigen::Map<const Vector>(weights.data(), channels).asDiagonal();
}

}  // namespace tokid::app
