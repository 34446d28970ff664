// Finds the sample time in a file of arrays that has no data set `dt`, under other common names.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "io/formats/fields.hpp"

namespace tokid::io {

struct SampleTime {
  std::optional<double> dt;           // [s]
  std::optional<std::string> remark;  // on a data set whose name suggests a sample time, but which is not used
};

// Finds the sample time in a file whose data sets have the names `names`, for T = `steps` steps. It is MATLAB's `Ts`,
// one positive number, or the spacing of `t` or `time`, the T even times of all steps [s]. `read` reads data sets of
// the file. A data set that cannot be read is ignored.
SampleTime sample_time(const Names& names, Index steps, const std::function<Contents(const Names& wanted)>& read);

// A remark if the file contains a `Ts` that differs from `dt`.
std::optional<std::string> contradiction(double dt, const Names& names,
                                         const std::function<Contents(const Names& wanted)>& read);

// Sets the sample time of an ensemble or of its outline, if its `dt` is not stated.
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
