// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "data/subjects.hpp"
#include "model/continuation.hpp"

namespace tokid {

Findings findings_of_end(const Model& model, const Ensemble& data) {
  if (goes_on(model) || data.steps() <= model.k_end()) return {};
  return {{.kind = Finding::Kind::model_ends_early,
           .numbers = {{"last", double(model.k_end() - 1)}, {"steps", double(data.steps() - model.k_end())}}}};
}

Findings differences(const Model& model, const Ensemble& data) {
  Findings result;
  // Sample times count as equal if they differ only by rounding to single precision or to decimal text.
  if (data.dt_stated && std::abs(model.dt - data.dt) > 1e-6 * model.dt)
    result.push_back({.kind = Finding::Kind::sample_time_differs,
                      .numbers = {{"data", data.dt}, {"model", model.dt}, {"stated", model.provenance.dt_stated}}});
  const bool with_outputs = data.outputs() > 0;
  const auto compare = [&result](Finding::Kind kind, const std::vector<std::string>& found,
                                 const std::vector<std::string>& known, auto&& channel_of) {
    if (found.empty() || known.empty() || found == known) return;
    Finding finding{.kind = kind, .names = known};
    for (size_t c = 0; c < found.size(); ++c) finding.channels.push_back(channel_of(Index(c)));
    result.push_back(std::move(finding));
  };
  compare(Finding::Kind::input_names_differ, data.names.input_names, model.names.input_names,
          [&](Index i) { return input_channel(data.names, i); });
  if (with_outputs)
    compare(Finding::Kind::output_names_differ, data.names.output_names, model.names.output_names,
            [&](Index j) { return output_channel(data.names, j); });
  const auto compare_units = [&result](const std::vector<std::string>& found, const std::vector<std::string>& known,
                                       auto&& channel_of) {
    for (size_t c = 0; c < std::min(found.size(), known.size()); ++c)
      if (!found[c].empty() && !known[c].empty() && found[c] != known[c])
        result.push_back(
            {.kind = Finding::Kind::units_differ, .channels = {channel_of(Index(c))}, .names = {found[c], known[c]}});
  };
  compare_units(data.names.input_units, model.names.input_units,
                [&](Index i) { return input_channel(model.names, i); });
  if (with_outputs)
    compare_units(data.names.output_units, model.names.output_units,
                  [&](Index j) { return output_channel(model.names, j); });
  return result;
}

}  // namespace tokid
