// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/provenance_words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/json.hpp"
#include "base/words.hpp"
#include "model/options.hpp"

namespace tokid::io {

namespace {

std::string penalty_text(double smoothing) { return std::isinf(smoothing) ? "infinity" : words::figure(smoothing); }

// "0.2", "zero", "3, 7"
std::string value_text(const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_float()) return words::figure(value.get<double>());
  if (!value.is_array()) return text_of(value);
  std::vector<std::string> parts;
  for (const Json& part : value) parts.push_back(value_text(part));
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::string options_text(const IdentifyOptions& options) {
  const IdentifyOptions defaults;
  std::vector<std::string> parts;
  for (const Option& option : option_table()) {
    const Json value = option.write(options);
    if (value == option.write(defaults)) continue;
    std::string name = option.key;
    std::replace(name.begin(), name.end(), '_', ' ');
    parts.push_back(fmt::format("{} {}", name, value_text(value)));
  }
  if (parts.empty()) return "all at their defaults";
  return fmt::format("{}; the others at their defaults", fmt::join(parts, ", "));
}

std::string choices_text(const NoisyChoices& choices) {
  const IdentifyOptions weighting{.weighting = choices.weighting};
  const Index period = choices.variation.period;
  const std::string delays =
      choices.delays.empty() ? "" : fmt::format(", dead times {} steps", fmt::join(choices.delays, ", "));
  return fmt::format("{}lambda {} for the regressions and {} for the states, weighting {}{}",
                     period == 1  ? "one model for all steps, "
                     : period > 1 ? fmt::format("period {}, ", words::plural(period, "step"))
                                  : "",
                     penalty_text(choices.variation.smoothing), penalty_text(choices.state_smoothing),
                     value_text(find_option("weighting")->write(weighting)), delays);
}

std::string corrections_text(const Corrections& made) {
  const auto dropped = std::count_if(made.experiments.begin(), made.experiments.end(),
                                     [](const Corrections::Experiment& e) { return e.weight == 0; });
  std::vector<std::string> parts;
  if (dropped > 0) parts.push_back(words::plural(dropped, "experiment") + " dropped");
  if (const Index less = Index(made.experiments.size()) - dropped; less > 0)
    parts.push_back(words::plural(less, "experiment") + " downweighted");
  if (!made.samples.empty()) parts.push_back(words::plural(Index(made.samples.size()), "sample") + " dropped or moved");
  return fmt::format("{}", fmt::join(parts, ", "));
}

}  // namespace

std::vector<std::pair<std::string, std::string>> provenance_words(const Provenance& provenance) {
  std::vector<std::pair<std::string, std::string>> rows;
  if (!provenance.unread.empty())
    rows.emplace_back("Options", provenance.unread);
  else if (provenance.options)
    rows.emplace_back("Options", options_text(*provenance.options));
  if (provenance.choices) rows.emplace_back("Chosen", choices_text(*provenance.choices));
  if (const auto& em = provenance.refinement)
    rows.emplace_back("Refined", fmt::format("by {} of EM with lambda {}", words::plural(em->iterations, "iteration"),
                                             penalty_text(em->smoothing)));
  if (!provenance.corrections.empty()) rows.emplace_back("Corrected", corrections_text(provenance.corrections));
  return rows;
}

}  // namespace tokid::io
