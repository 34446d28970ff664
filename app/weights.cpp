// SPDX-License-Identifier: BSD-3-Clause
#include "weights.hpp"

#include <limits>
#include <optional>

#include "common.hpp"

namespace tokid::app {

void add_weights(Command& command, const char* option, Weights& target, const char* description) {
  const auto parse = [](const std::string& text) -> std::optional<Weights> {
    Weights values;
    for (const std::string& part : split_at_commas(text)) {
      const auto value = parse_number(part, 0.0, std::numeric_limits<double>::max());
      if (!value) return std::nullopt;
      values.push_back(*value);
    }
    return values;
  };
  command.value(option, target, "W,...", description, parse, "numbers from 0 on needed, such as 2 or 0.5,2");
}

Matrix diagonal(const char* option, const Weights& weights, Index channels) {
  if (weights.size() == 1) return weights[0] * Matrix::Identity(channels, channels);
  if (Index(weights.size()) != channels)
    throw std::invalid_argument(fmt::format("{}: {} numbers found, one or one for each of {} channels needed", option,
                                            weights.size(), channels));
  return Eigen::Map<const Vector>(weights.data(), channels).asDiagonal();
}

std::string list(const Weights& weights) {
  std::string text;
  for (const double value : weights) text += (text.empty() ? "" : ", ") + number(value);
  return text;
}

}  // namespace tokid::app
