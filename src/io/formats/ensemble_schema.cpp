// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "base/json.hpp"
#include "base/words.hpp"
#include "data/experiment_names.hpp"
#include "io/formats/provenance_text.hpp"
#include "io/formats/schema.hpp"
#include "linalg/transposition.hpp"

namespace tokid::io {

namespace {

struct ChannelField {
  const char* name;
  std::vector<std::string> Channels::*list;
};
constexpr ChannelField channel_fields[] = {{"input_names", &Channels::input_names},
                                           {"output_names", &Channels::output_names},
                                           {"input_units", &Channels::input_units},
                                           {"output_units", &Channels::output_units}};

// ---- shapes: all forms in a file become (N, T, channels) ----

Shape one_experiment(const Shape& shape) { return {1, shape[0], shape[1]}; }
Shape one_channel(const Shape& shape) { return {shape[0], shape[1], 1}; }

bool is_grid(const Shape& shape, const Shape& other) { return shape[0] == other[0] && shape[1] == other[1]; }

// For shapes that do not match: reports which of them would match with another order of the axes.
std::string in_other_order(const Shape& u, const Shape& y) {
  if (u.size() != y.size() || (u.size() == 3 && u[0] != y[0])) return "";
  const size_t steps = u.size() - 2, channels = u.size() - 1;
  if (u[channels] == y[channels] && u[channels] > std::max(u[steps], y[steps])) return "both look";
  if (u[channels] == y[steps] && u[channels] > u[steps]) return "'u' looks";
  if (y[channels] == u[steps] && y[channels] > y[steps]) return "'y' looks";
  return "";
}

// `u` and `y`: the shapes in the file. `read_u` and `read_y`: their interpretation as (N, T, channels).
[[noreturn]] void fail_grid(const Shape& u, const Shape& y, const Shape& read_u, const Shape& read_y) {
  const std::string looks = in_other_order(u, y);
  const bool one = u.size() == 2 && y.size() == 2 && read_u == one_experiment(u);
  if (looks.empty())
    fail_shape("y", y,
               one ? fmt::format("({}, channels) like 'u'", u[0])
                   : fmt::format("({}, {}, channels) like 'u'", read_u[0], read_u[1]));
  const auto steps = [](const Shape& shape, const char* channel) {
    return fmt::format("{} with {}", words::plural(Index(shape[1]), "step"), words::plural(Index(shape[2]), channel));
  };
  fail("data sets 'u' and 'y': shapes {} and {} found, read as {} of {}, and {}; {} like {}, {} needed", text(u),
       text(y), words::plural(Index(read_u[0]), "experiment"), steps(read_u, "input"), steps(read_y, "output"), looks,
       one ? "(channels, T)" : "(N, channels, T)", one ? "(T, channels)" : "(N, T, channels)");
}

Shape beside(const char* name, const Shape& shape, const char* other_name, const Shape& other, Layout layout) {
  const bool is_channel = is_grid(shape, other), is_experiment = other[0] == 1 && shape[0] == other[1];
  if (layout == Layout::matlab && is_channel) return one_channel(shape);
  if (is_experiment) return one_experiment(shape);
  fail_shape(name, shape,
             is_channel ? fmt::format("{} beside '{}' of shape {}", text(one_channel(shape)), other_name, text(other))
                        : fmt::format("({}, {}, channels) like '{}'", other[0], other[1], other_name));
}

// Restores the trailing ones that MATLAB drops. `experiments` confirms that the first axis is still N.
Shape with_trailing_ones(const char* name, Shape shape, Index experiments) {
  const Shape found = shape;
  if (shape.size() < 3) shape.resize(3, 1);
  if (shape[0] != size(experiments))
    fail_shape(name, found, fmt::format("{} rows, the number in 'experiments',", experiments));
  return shape;
}

struct Shapes {
  Shape u, y;
};

Shapes shapes_of(const Fields& fields, bool has_outputs) {
  Shapes s{fields.shape("u"), has_outputs ? fields.shape("y") : Shape{}};
  const auto check_rank = [](const char* name, const Shape& shape) {
    if (shape.size() != 2 && shape.size() != 3)
      fail_shape(name, shape, "(N, T, channels), or (T, channels) for one experiment,");
  };
  check_rank("u", s.u);
  if (has_outputs) check_rank("y", s.y);
  if (fields.layout() == Layout::matlab && fields.has("experiments")) {
    const Index n = fields.integer("experiments");
    s.u = with_trailing_ones("u", s.u, n);
    if (has_outputs) s.y = with_trailing_ones("y", s.y, n);
  } else {
    if (s.u.size() == 2) s.u = s.y.size() == 3 ? beside("u", s.u, "y", s.y, fields.layout()) : one_experiment(s.u);
    if (s.y.size() == 2)
      s.y = fields.shape("u").size() == 3 ? beside("y", s.y, "u", s.u, fields.layout()) : one_experiment(s.y);
  }
  if (!has_outputs) s.y = {s.u[0], s.u[1], 0};
  if (!is_grid(s.y, s.u)) fail_grid(fields.shape("u"), fields.shape("y"), s.u, s.y);
  if (s.u[0] == 0 || s.u[1] == 0 || s.u[2] + s.y[2] == 0)
    fail_shape("u", fields.shape("u"), "at least one experiment of one step with one channel");
  return s;
}

Shape free_shape(const Fields& fields, size_t outputs) {
  const Shape& found = fields.shape("free_y");
  Shape shape = found;
  if (shape.size() == 2) {
    const bool dropped_one =
        fields.layout() == Layout::matlab && outputs == 1 && (shape[1] != 1 || fields.has("experiments"));
    shape = dropped_one ? one_channel(shape) : one_experiment(shape);
  }
  if (shape.size() != 3 || shape[2] != outputs)
    fail_shape("free_y", found, fmt::format("(experiments, steps, {}) like the outputs", outputs));
  return shape;
}

// ---- samples ----

// Calls f(n, k, c, index of the sample in a row-major array) for every sample. It goes through few steps at a time, so
// that these samples stay in the cache for both orders of storage.
template <typename F>
void each_sample(Index experiments, Index steps, Index channels, F&& f) {
  constexpr Index piece = 32;
  for (Index begin = 0; begin < steps; begin += piece)
    for (Index n = 0; n < experiments; ++n) {
      size_t at = size((n * steps + begin) * channels);
      for (Index k = begin; k < std::min(begin + piece, steps); ++k)
        for (Index c = 0; c < channels; ++c) f(n, k, c, at++);
    }
}

template <typename F>
Array samples_array(Index experiments, Index steps, Index channels, F&& sample) {
  const Shape shape{size(experiments), size(steps), size(channels)};
  std::vector<double> values(checked_product(shape));
  each_sample(experiments, steps, channels,
              [&](Index n, Index k, Index c, size_t at) { values[at] = sample(n, k, c); });
  return {shape, std::move(values)};
}

FreeResponse free_response_of(const Fields& fields, Index outputs) {
  const auto& values = fields.numbers("free_y");
  const Shape shape = free_shape(fields, size(outputs));
  if (values.empty()) return {};
  FreeResponse free{static_cast<Index>(shape[0]), static_cast<Index>(shape[1]), {}};
  free.y.resize(free.experiments, free.steps * outputs);
  each_sample(free.experiments, free.steps, outputs,
              [&](Index n, Index k, Index j, size_t at) { free.y(n, k * outputs + j) = values[at]; });
  return free;
}

}  // namespace

Provenance checked_provenance(const std::string& options, const std::string& program_version) {
  if (is_modest(options)) return provenance_of(options, program_version);
  const JsonMeasure found = measure_json(options);
  fail(
      "data set 'options': too large, with {} bytes, {} levels of brackets and {} keys. At most {}, {} and {} are allowed",
      options.size(), found.depth, found.keys, longest_options, deepest_options, most_options);
}

Array scalar(double value) { return {{}, std::vector<double>{value}}; }
Array scalar(Index value) { return {{}, std::vector<std::int64_t>{value}}; }
Array scalar(const std::string& value) { return {{}, std::vector<std::string>{value}}; }
Array list(const std::vector<Index>& values) {
  return {{values.size()}, std::vector<std::int64_t>(values.begin(), values.end())};
}

void add_channels(const Channels& channels, Arrays& arrays) {
  for (const auto& [name, field] : channel_fields) {
    const auto& texts = channels.*field;
    if (!texts.empty()) arrays.emplace_back(name, Array{{texts.size()}, texts});
  }
}

Channels channels_of(const Fields& fields) {
  Channels channels;
  for (const auto& [name, field] : channel_fields)
    if (fields.has(name)) channels.*field = fields.texts(name);
  return channels;
}

const Names& ensemble_names() {
  static const Names names{"u",
                           "y",
                           "dt",
                           "length",
                           "experiment_names",
                           "free_y",
                           "input_names",
                           "output_names",
                           "input_units",
                           "output_units",
                           "initial_state",
                           "experiments"};
  return names;
}

bool is_ensemble(const Names& found) { return !is_model(found) && (contains(found, "u") || contains(found, "y")); }

void check_sizes(const Ensemble& e) {
  const auto check = [](const char* name, size_t found, Index needed) {
    if (found != 0 && found != size(needed)) fail("{}: {} entries found, {} needed", name, found, needed);
  };
  check("length", e.length.size(), e.experiments());
  if (const std::string fault = fault_of_experiment_names(e.experiment_names, e.experiments()); !fault.empty())
    fail("{}", fault);
  check("input_names", e.names.input_names.size(), e.inputs());
  check("input_units", e.names.input_units.size(), e.inputs());
  check("output_names", e.names.output_names.size(), e.outputs());
  check("output_units", e.names.output_units.size(), e.outputs());
  if (e.free.y.rows() != e.free.experiments || e.free.y.cols() != e.free.steps * e.outputs())
    fail_shape("free_y", {size(e.free.y.rows()), size(e.free.y.cols())},
               fmt::format("({}, {} x {})", e.free.experiments, e.free.steps, e.outputs()));
}

Arrays arrays_of(const Ensemble& e, Layout layout) {
  Arrays arrays;
  if (e.dt_stated) arrays.emplace_back("dt", scalar(e.dt));
  if (layout == Layout::matlab) arrays.emplace_back("experiments", scalar(e.experiments()));
  if (e.initial_state) arrays.emplace_back("initial_state", scalar(std::string(to_string(*e.initial_state))));
  if (!e.length.empty()) arrays.emplace_back("length", list(e.length));
  if (!e.experiment_names.empty())
    arrays.emplace_back("experiment_names", Array{{e.experiment_names.size()}, e.experiment_names});
  add_channels(e.names, arrays);
  if (e.free.experiments > 0)
    arrays.emplace_back("free_y",
                        samples_array(e.free.experiments, e.free.steps, e.outputs(),
                                      [&](Index n, Index k, Index j) { return e.free.y(n, k * e.outputs() + j); }));
  arrays.emplace_back("u", samples_array(e.experiments(), e.steps(), e.inputs(),
                                         [&](Index n, Index k, Index i) { return e.u(n, k, i); }));
  if (e.outputs() > 0)
    arrays.emplace_back("y", samples_array(e.experiments(), e.steps(), e.outputs(),
                                           [&](Index n, Index k, Index j) { return e.y(n, k, j); }));
  return arrays;
}

EnsembleOutline outline_of(const Fields& fields, bool outputs_required) {
  const bool has_outputs = outputs_required || fields.has("y");
  fields.numbers("u");
  if (has_outputs) fields.numbers("y");
  EnsembleOutline outline;
  const Shapes shapes = shapes_of(fields, has_outputs);
  if (outputs_required && shapes.y[2] == 0) fail_shape("y", fields.shape("y"), "at least one output");
  const auto at = [](const Shape& shape, size_t axis) { return static_cast<Index>(shape[axis]); };
  outline.experiments = at(shapes.u, 0);
  outline.steps = at(shapes.u, 1);
  outline.inputs = at(shapes.u, 2);
  outline.outputs = at(shapes.y, 2);
  outline.dt_stated = fields.has("dt");
  if (outline.dt_stated) outline.dt = fields.number("dt");
  outline.names = channels_of(fields);
  if (fields.has("initial_state")) outline.initial_state = initial_state_from(fields.text("initial_state"));
  if (fields.has("length")) outline.length = fields.integers("length", shapes.u[0], 0, outline.steps);
  if (fields.has("experiment_names")) outline.experiment_names = fields.labels("experiment_names");
  if (fields.has("free_y")) outline.free = free_response_of(fields, outline.outputs);
  return outline;
}

Ensemble ensemble_of(const Fields& fields, bool outputs_required) {
  EnsembleOutline outline = outline_of(fields, outputs_required);
  Ensemble e(outline.experiments, outline.steps, outline.inputs, outline.outputs, outline.dt, Ensemble::Samples::unset);
  static const std::vector<double> none;
  const auto& u = fields.numbers("u");
  const auto& y = e.outputs() > 0 ? fields.numbers("y") : none;
  const auto take = [&e](const std::vector<double>& values, Index channels, Index first) {
    std::vector<double*> columns;
    for (Index k = 0; k < e.steps(); ++k)
      for (Index c = 0; c < channels; ++c) columns.push_back(e.samples().col(k * e.channels() + first + c).data());
    linalg::transpose(values.data(), e.experiments(), e.steps() * channels, columns);
  };
  take(u, e.inputs(), 0);
  take(y, e.outputs(), e.inputs());
  e.dt_stated = outline.dt_stated;
  e.names = std::move(outline.names);
  e.initial_state = outline.initial_state;
  set_length(e, std::move(outline.length));
  set_experiment_names(e, std::move(outline.experiment_names));
  e.free = std::move(outline.free);
  e.check(outputs_required);
  return e;
}

}  // namespace tokid::io
