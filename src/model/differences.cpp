// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/words.hpp"
#include "tokid/provenance.hpp"

namespace tokid {

std::optional<std::string> steps_beyond(const Model& model, const Ensemble& data) {
  if (model.period > 0 || data.steps() <= model.k_end()) return std::nullopt;
  return fmt::format("the model ends with step {}: it says nothing of the last {} of the data", model.k_end() - 1,
                     words::plural(data.steps() - model.k_end(), "step"));
}

std::vector<std::string> differences(const Model& model, const Ensemble& data) {
  std::vector<std::string> result;
  // Sample times that went through single precision or decimal text are still the same.
  if (data.dt_stated && std::abs(model.dt - data.dt) > 1e-6 * model.dt)
    result.push_back(fmt::format("the data's dt = {} s differs from the model's dt = {} s{}", data.dt, model.dt,
                                 states_dt(model) ? "" : ", which was identified from data without a sample time"));
  const auto compare = [&result](const char* what, const std::vector<std::string>& found,
                                 const std::vector<std::string>& known) {
    if (!found.empty() && !known.empty() && found != known)
      result.push_back(fmt::format("the data's {} are named {}, the model's {}", what, fmt::join(found, ", "),
                                   fmt::join(known, ", ")));
  };
  compare("inputs", data.names.input_names, model.names.input_names);
  if (data.outputs() > 0) compare("outputs", data.names.output_names, model.names.output_names);
  const auto compare_units = [&result](const auto& name, const std::vector<std::string>& found,
                                       const std::vector<std::string>& known) {
    for (size_t c = 0; c < std::min(found.size(), known.size()); ++c)
      if (!found[c].empty() && !known[c].empty() && found[c] != known[c])
        result.push_back(fmt::format("the data's {} is in {}, the model's in {}: nothing is converted", name(Index(c)),
                                     found[c], known[c]));
  };
  compare_units([&](Index i) { return "input " + model.names.input(i); }, data.names.input_units,
                model.names.input_units);
  if (data.outputs() > 0)
    compare_units([&](Index j) { return "output " + model.names.output(j); }, data.names.output_units,
                  model.names.output_units);
  return result;
}

}  // namespace tokid
