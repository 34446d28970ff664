// Finds the sample time of a file of arrays without a data set `dt`, under other common names.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "io/formats/fields.hpp"

namespace tokid::io {

struct SampleTime {
  std::optional<double> dt;           // [s]
  std::optional<std::string> remark;  // on a data set that looks like a sample time or times and is neither
};

// Looks for it in a file with data sets of these names and T steps: MATLAB's `Ts`, one positive number; or `t` or
// `time`, the T even times of all steps [s]. `read` reads data sets of the file. A data set that it cannot read is
// ignored.
SampleTime sample_time(const Names& names, Index steps, const std::function<Contents(const Names& wanted)>& read);

// A remark if `Ts` is another sample time than the `dt` that was taken.
std::optional<std::string> contradiction(double dt, const Names& names,
                                         const std::function<Contents(const Names& wanted)>& read);

// Sets the sample time of an ensemble, or of its outline, if it states none.
template <class Data, class Read>
void complete_sample_time(Data& data, Index steps, const Names& names, Read&& read) {
  if (data.dt_stated) {
    if (auto remark = contradiction(data.dt, names, read)) data.remarks.push_back(*std::move(remark));
    return;
  }
  const SampleTime found = sample_time(names, steps, read);
  data.dt_stated = found.dt.has_value();
  data.dt = found.dt.value_or(data.dt);
  if (found.remark) data.remarks.push_back(*found.remark);
}

}  // namespace tokid::io
