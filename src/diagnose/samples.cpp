// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/samples.hpp"

#include <utility>

#include "base/integers.hpp"
#include "diagnose/excitation.hpp"
#include "tokid/copies.hpp"
#include "tokid/remarks.hpp"

namespace tokid {

Findings findings_of_samples(const Ensemble& e, Survey samples, Extent reached, Index period) {
  for (std::vector<Index>& steps : samples.alone)
    std::erase_if(steps, [&](Index k) { return k < reached.begin || k >= reached.end; });
  Findings result =
      period > 0 ? findings_of_inputs(samples, e.names, period, e.steps()) : findings_of_inputs(samples, e.names);
  append(result, findings_of_outputs(samples, e.names));
  append(result, findings_of_dependent_outputs(e));
  return result;
}

Findings sample_remarks(const Ensemble& data) {
  if (data.outputs() == 0 || data.experiments() == 0 || data.steps() == 0) return {};
  const UsedExperiments used = used_experiments(data);
  const Ensemble part = used.all(data) ? data : data.subset(used.rows);
  Findings result = findings_of(used, data);
  if (part.experiments() == 1) {  // it can be that of a time-invariant system only
    append(result, findings_of_samples(part, survey(part, 0, part.steps()), {0, part.steps()}, 1));
    return result;
  }
  const Extent steps = reached(part, fewest_at_a_step);
  append(result, findings_of_reach(data, used.rows, steps, fewest_at_a_step));
  append(result, findings_of_overlap(data));
  const Ensemble compared = stretch(part, 0, steps.end);
  append(result, findings_of_samples(compared, survey(compared, 0, steps.end), steps, 0));
  return result;
}

}  // namespace tokid
