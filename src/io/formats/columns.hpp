// The columns of a table: which are inputs and outputs, and which states the steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/cells.hpp"
#include "io/formats/time_unit.hpp"

namespace tokid::io {

// May a channel of a .csv that tokid writes not have this name, because a column of the format has it?
bool is_reserved(const std::string& name);

// What the first rows of a column contain.
enum class Content { other, date_and_clock, date, clock };

struct Column {
  std::string title;  // as in the header, with its unit: "p [bar]"
  Label label;        // "p" and "bar"; the unit may come from a row of units
  Content content = Content::other;
};

// The columns by their titles and names.
class Header {
 public:
  Header(std::vector<Column> columns, Index line);

  const std::vector<Column>& columns() const { return columns_; }
  const Column& operator[](size_t c) const { return columns_[c]; }
  Names titles() const;
  std::string place() const;  // for the end of messages: the line that was taken for the header
  // The column with this title, or else with this name without a unit. "Experiment" and "time" may have capital
  // letters. \throws IoError for several such columns, and for a name with another unit
  std::optional<size_t> find(const std::string& name) const;
  size_t need(const std::string& name) const;  // \throws IoError that lists the columns

 private:
  using Places = std::unordered_map<std::string, std::vector<size_t>>;
  static std::optional<size_t> only(const Places& places, const std::string& key, const std::string& name);

  std::vector<Column> columns_;
  Index line_;
  Places by_title_, by_name_;
};

Names titles_of(const Header& header, const std::vector<size_t>& columns);

struct Chosen {
  std::vector<size_t> inputs, outputs;
  std::optional<size_t> experiment, time, step;
  std::optional<size_t> date;  // its dates and the times of day of `time` are the times
  bool stamped = false;        // times are time stamps
  bool of_minutes = false;     // the unit of these stamps is mm:ss
  TimeUnit unit;               // of the times
};

struct Wanted {
  Names inputs, outputs;   // that the caller states
  std::string time;        // the column of times that the caller states
  std::string experiment;  // the column of the names of experiments that the caller states
  Channels noted;          // names in the comments of the file
  Channels model;          // channels of a model: taken if the table has all of them, and nothing else is stated
  bool outputs_required = true;
};

// \throws IoError if there is no input or no output; the message lists the columns
Chosen chosen_columns(const Header& header, const Wanted& wanted);

// The names and units of the channels. Default names are dropped, unless the comments of the file state them.
Channels channels_of(const Header& header, const Chosen& chosen, const Wanted& wanted);

// The columns that are not read, apart from those in `read`.
std::vector<size_t> unused_columns(const Header& header, const Chosen& chosen, const std::vector<size_t>& read);

// Does the name of a column suggest that it names experiments: "run", "Batch no", "Versuch"?
bool may_name_experiments(const std::string& name);

// A remark on the columns that are not read, apart from those in `read`.
std::optional<std::string> remark_on_unused_columns(const Header& header, const Chosen& chosen,
                                                    const std::vector<size_t>& read);

}  // namespace tokid::io
