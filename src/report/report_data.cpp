// SPDX-License-Identifier: BSD-3-Clause
#include "report/report_data.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <set>
#include <stdexcept>

#include "base/finding_json.hpp"
#include "base/integers.hpp"
#include "base/nan.hpp"
#include "base/words.hpp"
#include "report/verdict_json.hpp"

namespace tokid::report {

namespace {

// The most numbers of each kind on the page. Each number takes about seven bytes.
constexpr Index most_trace_numbers = 400'000;
constexpr Index most_entry_numbers = 60'000;  // of A_k, and as many of G_k
constexpr Index most_poles = 50'000;
constexpr Index most_heat_columns = 1200, most_heat_rows = 32;
constexpr Index most_states_shown = 12;
constexpr Index most_modes = 12, most_mode_numbers = 60'000;
constexpr Index most_response_channels = 12;
constexpr Index most_correlated_inputs = 24, most_correlated_outputs = 12;
constexpr size_t most_finding_steps = 10'000;
constexpr Index most_worst_experiments = 1000, most_other_experiments = 1000;
constexpr Index fewest_points = 120;  // of each curve, however many curves there are
// Responses of a model in other coordinates differ by rounding errors, which ill-conditioned coordinates multiply. The
// plots show six digits: a smaller difference from the model of the bands would not be seen.
constexpr double same_response = 1e-6;

// Are all responses the same, relative to their largest entry?
bool same_responses(const std::vector<Matrix>& a, const std::vector<Matrix>& b) {
  if (a.size() != b.size()) return false;
  double difference = 0.0, size = 0.0;
  for (size_t s = 0; s < a.size(); ++s) {
    if (a[s].rows() != b[s].rows() || a[s].cols() != b[s].cols()) return false;
    for (Index i = 0; i < a[s].size(); ++i) {
      const double x = a[s].reshaped()(i), y = b[s].reshaped()(i);
      if (x == y || (std::isnan(x) && std::isnan(y))) continue;
      const double change = std::abs(x - y);
      if (!std::isfinite(change)) return false;
      difference = std::max(difference, change);
      size = std::max({size, std::abs(x), std::abs(y)});
    }
    for (const double x : a[s].reshaped())
      if (std::isfinite(x)) size = std::max(size, std::abs(x));
  }
  return difference <= same_response * size;
}

constexpr const char* wrong_bands =
    "bands: those of another model or of other steps found, those of response_bands(model) at the steps of the page "
    "needed";

// Real and imaginary parts, one after the other. The phase of a very small response is arbitrary.
std::vector<Matrix> parts_of(const std::vector<Matrix>& magnitude, const std::vector<Matrix>& phase) {
  std::vector<Matrix> result;
  if (magnitude.size() != phase.size()) return result;
  for (size_t s = 0; s < magnitude.size(); ++s) {
    if (magnitude[s].rows() != phase[s].rows() || magnitude[s].cols() != phase[s].cols()) return {};
    result.emplace_back(magnitude[s].array() * phase[s].array().cos());
    result.emplace_back(magnitude[s].array() * phase[s].array().sin());
  }
  return result;
}

// Rounds to six digits, which is more than a plot can show. A value that is not finite becomes null.
Json rounded(double value) {
  if (!std::isfinite(value)) return {};
  if (value == std::trunc(value) && std::abs(value) < 1e6) return static_cast<std::int64_t>(value);
  const std::string text = fmt::format("{:.6g}", value);
  double result = value;
  std::from_chars(text.data(), text.data() + text.size(), result);
  return result;
}

Json rounded(const std::vector<double>& values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(rounded(value));
  return list;
}

Json channels(Index count, const std::function<std::string(Index)>& name, const std::vector<std::string>& units) {
  Json list = Json::array();
  for (Index i = 0; i < count; ++i)
    list.push_back({{"name", name(i)}, {"unit", size_t(i) < units.size() ? units[size_t(i)] : ""}});
  return list;
}

}  // namespace

Grid make_grid(Index begin, Index steps, Index points) {
  Grid grid{begin, steps, 1, {}};
  points = std::max<Index>(2, points);
  if (steps > points) grid.stretch = (2 * steps + points - 1) / points;
  if (grid.stretch == 1) {
    for (Index k = 0; k < steps; ++k) grid.x.push_back(begin + k);
    return grid;
  }
  for (Index k = 0; k < steps; k += grid.stretch) {
    grid.x.push_back(begin + k);
    // Each stretch has two points at different places, even if the last stretch is a single step.
    grid.x.push_back(begin + k + std::max<Index>(1, grid.stretch / 2));
  }
  return grid;
}

std::vector<double> Grid::thin(const std::vector<double>& values) const {
  if (stretch == 1) return values;
  std::vector<double> result;
  result.reserve(x.size());
  for (Index k = 0; k < steps; k += stretch) {
    Index least = -1, most = -1;
    for (Index i = k; i < std::min(steps, k + stretch); ++i) {
      const double value = values[size_t(i)];
      if (!std::isfinite(value)) continue;
      if (least < 0 || value < values[size_t(least)]) least = i;
      if (most < 0 || value > values[size_t(most)]) most = i;
    }
    if (least < 0) {
      result.insert(result.end(), 2, nan);
      continue;
    }
    result.push_back(values[size_t(std::min(least, most))]);
    result.push_back(values[size_t(std::max(least, most))]);
  }
  return result;
}

Framed pole_frame(const Model& model) {
  Framed framed;
  const Index n = model.states();
  const Index rows = std::max(model.max_lags(), n > 0 ? (n + model.outputs - 1) / model.outputs : 1);
  if (n > 0) {
    const Index s = model.full_begin(), full = model.full_end() - s;
    try {
      FramedModel reference = reference_frame(model, s, rows);
      // The reference frame is used only if it contains at least half of the steps. A shorter frame would show too
      // little.
      if (2 * (reference.end - reference.begin) >= full && reference.end - reference.begin > 1)
        return {std::move(reference.model), "reference", reference.begin, reference.end - 1, s};
    } catch (const std::invalid_argument&) {
      // The outputs from step s on do not determine its state. The smooth frame does not need this.
    }
  }
  return {smooth_frame(model, rows), "smooth", model.k_begin, model.k_end(), -1};
}

std::vector<Index> outlying_samples(const Evidence& found) {
  std::vector<Index> result(size_t(found.experiments), 0);
  for (const OutlyingSamples& o : found.validation.outlying) result[size_t(o.experiment)] += Index(o.steps.size());
  return result;
}

Shown shown_experiments(const Evidence& found, Index most) {
  const std::vector<Index>& order = found.fits.worst_first;
  const Index total = found.fits.experiments();
  most = std::clamp<Index>(most, 1, std::max<Index>(1, total));
  const Index known = total - found.fits.excess.array().isNaN().count();

  Shown shown;
  Index best = -1, middle = -1, worst = -1;
  if (known > 0) {
    worst = order.front();
    middle = order[size_t(known / 2)];
    best = order[size_t(known - 1)];
  }
  std::vector<bool> taken(size_t(total), false);
  Index count = 0;
  for (const Index n : {middle, worst, best})
    if (n >= 0 && count < most && !taken[size_t(n)]) taken[size_t(n)] = true, ++count;
  for (Index i = 0; i < most && count < most; ++i) {
    Index n = i * total / most;
    while (n < total && taken[size_t(n)]) ++n;
    if (n < total) taken[size_t(n)] = true, ++count;
  }
  for (Index n = 0; n < total; ++n) {
    if (!taken[size_t(n)]) continue;
    std::string label = fmt::format("Experiment {}", found.experiment(n));
    if (total > 1 && n == worst)
      label += " (largest error)";
    else if (total > 1 && n == best)
      label += " (smallest error)";
    else if (total > 2 && n == middle)
      label += " (median error)";
    if (n == middle) shown.first = shown.rows.size();
    shown.rows.push_back(n);
    shown.labels.push_back(std::move(label));
  }
  return shown;
}

namespace {

// Collects the data as JSON, and reports what is left out.
class Collector {
 public:
  Collector(const Model& model, const Ensemble& data, const Evidence& found, const ModelComparison& comparison,
            const ReportOptions& options)
      : model_(model), data_(data), found_(found), comparison_(comparison), options_(options), plots_{{},
                                                                                                      {},
                                                                                                      pole_frame(model),
                                                                                                      {},
                                                                                                      {},
                                                                                                      {}} {}

  Plots collect(const Verdict& verdict) {
    json_["dt"] = rounded(data_.dt);
    json_["dt_stated"] = data_.dt_stated;
    json_["steps"] = data_.steps();
    json_["models"] = Json::array();
    for (const ComparedModel& one : comparison_.models) json_["models"].push_back(words::quoted(one.name));
    json_["begin"] = model_.k_begin;
    json_["end"] = model_.k_end();
    const Channels& names = found_.names;
    json_["inputs"] = channels(
        model_.inputs, [&](Index i) { return names.input(i); }, names.input_units);
    json_["outputs"] = channels(
        model_.outputs, [&](Index j) { return names.output(j); }, names.output_units);
    traces();
    experiments();
    singular_values();
    steps();
    poles();
    entries();
    responses();
    modes_over_time();
    frozen();
    whiteness();
    input_correlation();
    findings();
    checks(verdict);
    plots_.json = text_of(json_);
    return std::move(plots_);
  }

 private:
  template <class... Arguments>
  void omit(fmt::format_string<Arguments...> text, Arguments&&... arguments) {
    plots_.omitted.push_back(fmt::format(text, std::forward<Arguments>(arguments)...));
  }

  // The number of points of each of `curves` curves, if all curves together may have `budget` numbers.
  Index points_for(Index curves, Index budget) const {
    const Index fair = std::max(fewest_points, budget / std::max<Index>(1, curves));
    return std::min(fair, std::max<Index>(2, options_.points));  // the option may ask for fewer than fewest_points
  }

  template <class Value>
  Json curve(const Grid& grid, Value&& value) const {
    std::vector<double> values(size_t(grid.steps), nan);
    for (Index k = 0; k < grid.steps; ++k) values[size_t(k)] = value(grid.begin + k);
    return rounded(grid.thin(values));
  }

  void traces() {
    const Index compared = std::max<Index>(0, Index(comparison_.models.size()) - 1);
    const Index others = std::min(compared, most_compared_models);
    if (others < compared) omit("The plots show {} of {} compared models; the tables have all.", others, compared);
    const Index curves = model_.inputs + (5 + others) * model_.outputs;
    // The number of experiments is limited so that each curve has enough points.
    const Index fair = std::min({data_.steps(), options_.points, Index{400}});
    Index most = std::min(options_.experiments, most_trace_numbers / std::max<Index>(1, curves * fair));
    const Shown shown = shown_experiments(found_, std::max<Index>(1, most));
    const Index count = Index(shown.rows.size());
    const Grid grid = make_grid(0, data_.steps(), points_for(count * curves, most_trace_numbers));
    if (count < data_.experiments())
      omit(
          "The plots of outputs and inputs show {} of {} experiments: those with the smallest, median and largest "
          "error, "
          "and others spread evenly. All of them count in the figures.",
          count, data_.experiments());
    if (grid.stretch > 1)
      omit("Curves over time are drawn by the least and largest value of every {} steps, so that no peak is lost.",
           grid.stretch);

    Json list = Json::array();
    for (size_t i = 0; i < shown.rows.size(); ++i) list.push_back(experiment(grid, shown.rows[i], shown.labels[i]));
    Json nominal = nullptr;
    if (model_.y_nominal.rows() > 0)
      nominal = {{"u", all(grid, model_.inputs, [&](Index i, Index k) { return entry(model_.u_nominal, k, i); })},
                 {"y", all(grid, model_.outputs, [&](Index j, Index k) { return entry(model_.y_nominal, k, j); })}};
    json_["traces"] = {
        {"x", grid.x}, {"stretch", grid.stretch}, {"first", shown.first}, {"nominal", nominal}, {"experiments", list}};
  }

  static double entry(const Matrix& a, Index k, Index i) { return k < a.rows() ? a(k, i) : nan; }

  template <class Value>
  Json all(const Grid& grid, Index count, Value&& value) const {
    Json list = Json::array();
    for (Index i = 0; i < count; ++i) list.push_back(curve(grid, [&](Index k) { return value(i, k); }));
    return list;
  }

  Json experiment(const Grid& grid, Index n, const std::string& label) const {
    const Ensemble &simulated = found_.simulated, &predicted = found_.prediction.y;
    const Index m = model_.outputs;
    const auto difference = [&](const Ensemble& computed) {
      return all(grid, m, [&](Index j, Index k) { return data_.y(n, k, j) - computed.y(n, k, j); });
    };
    const std::string& name = found_.experiment_names[size_t(n)];
    Json others = Json::array();  // the simulations of the other models
    for (size_t i = 1; i < std::min(comparison_.models.size(), 1 + size_t(most_compared_models)); ++i)
      others.push_back(all(grid, m, [&](Index j, Index k) { return comparison_.models[i].simulated.y(n, k, j); }));
    return {{"others", others},
            {"label", label},
            {"row", found_.rows[size_t(n)]},
            {"name", name.empty() ? Json() : Json(words::quoted(name))},
            {"u", all(grid, model_.inputs, [&](Index i, Index k) { return data_.u(n, k, i); })},
            {"y", all(grid, m, [&](Index j, Index k) { return data_.y(n, k, j); })},
            {"simulated", all(grid, m, [&](Index j, Index k) { return simulated.y(n, k, j); })},
            {"predicted", all(grid, m, [&](Index j, Index k) { return predicted.y(n, k, j); })},
            {"simulation_error", difference(simulated)},
            {"prediction_error", difference(predicted)}};
  }

  // The errors of all experiments, the worst first. Of very many, the worst and an even selection of the others.
  void experiments() {
    const ExperimentFits& fits = found_.fits;
    const std::vector<Index>& order = fits.worst_first;
    const Index total = Index(order.size()), others = std::max<Index>(0, total - most_worst_experiments);
    const Index stride = std::max<Index>(1, (others + most_other_experiments - 1) / most_other_experiments);
    if (stride > 1)
      omit("The plot of all experiments shows the {} with the largest errors, and every {}th of the others.",
           most_worst_experiments, stride);
    const std::vector<Index> outlying = outlying_samples(found_);
    Json list{{"simulation_limit", rounded(fits.simulation_limit)}, {"one_step_limit", rounded(fits.one_step_limit)}};
    for (const char* key : {"x", "row", "name", "simulation_error", "one_step_error", "simulation_samples",
                            "one_step_samples", "excess", "outlying", "outlying_samples"})
      list[key] = Json::array();
    for (Index i = 0; i < total; i += i < most_worst_experiments ? 1 : stride) {
      const Index n = order[size_t(i)];
      const std::string& name = found_.experiment_names[size_t(n)];
      list["x"].push_back(i + 1);
      list["row"].push_back(found_.rows[size_t(n)]);
      list["name"].push_back(name.empty() ? Json() : Json(words::quoted(name)));
      list["simulation_error"].push_back(rounded(fits.simulation_error(n)));
      list["one_step_error"].push_back(rounded(fits.one_step_error(n)));
      list["simulation_samples"].push_back(fits.simulation_samples.row(n).sum());
      list["one_step_samples"].push_back(fits.one_step_samples.row(n).sum());
      list["excess"].push_back(rounded(fits.excess(n)));
      list["outlying"].push_back(fits.outlying(n));
      list["outlying_samples"].push_back(outlying[size_t(n)]);
    }
    json_["experiments"] = std::move(list);
  }

  // Stores the logarithms to base ten in hundredths, because these are small whole numbers.
  void singular_values() {
    json_["sigma"] = nullptr;
    Index rows = 0;
    for (const Step& step : model_.step) rows = std::max(rows, step.singular_values().size());
    if (rows == 0) return;
    if (rows > most_heat_rows)
      omit("Of {} singular values of every step the largest {} are drawn.", rows, most_heat_rows);
    rows = std::min(rows, most_heat_rows);
    const Index stride = (model_.steps() + most_heat_columns - 1) / most_heat_columns;
    if (stride > 1) omit("Of every {} steps the largest singular values and the largest order are drawn.", stride);
    // If the inputs have no effect on later outputs, all singular values are rounding errors. The scale must then come
    // from D, which is a Markov parameter, too.
    double largest = 0.0;
    for (const Step& step : model_.step)
      if (const auto s = step.singular_values(); s.size() > 0 && std::isfinite(s(0))) largest = std::max(largest, s(0));
    double scale = largest;
    for (const Step& step : model_.step)
      if (const Step::View d = step.D(); d.size() > 0 && d.allFinite())
        scale = std::max(scale, d.cwiseAbs().maxCoeff());
    Json columns = Json::array(), order = Json::array();
    for (Index k = 0; k < model_.steps(); k += stride) {
      std::vector<double> most;  // largest values of the steps in this column
      Index states = 0;
      for (Index i = k; i < std::min(model_.steps(), k + stride); ++i) {
        const auto s = model_.step[size_t(i)].singular_values();
        for (Index j = 0; j < std::min(rows, s.size()); ++j)
          if (size_t(j) < most.size())
            most[size_t(j)] = std::max(most[size_t(j)], s(j));
          else
            most.push_back(s(j));
        states = std::max(states, model_.step[size_t(i)].states());
      }
      Json column = Json::array();
      for (const double value : most) column.push_back(hundredths(std::max(value, scale * 1e-17)));
      columns.push_back(std::move(column));
      order.push_back(states);
    }
    json_["sigma"] = {
        {"begin", model_.k_begin}, {"stride", stride}, {"rows", rows}, {"rounding", hundredths(scale * 1e-12)},
        {"log", columns},          {"order", order}};
  }

  // Hundredths of the logarithm of a value. Values are at least 1e-17 times the scale, which is below double precision.
  // The result is null for zero, which happens only if all values are zero.
  static Json hundredths(double value) {
    if (!(value >= std::numeric_limits<double>::min())) return {};
    return std::lround(100 * std::log10(value));
  }

  void steps() {
    const Grid grid = make_grid(model_.k_begin, model_.steps(), options_.points);
    const auto list = [&](bool (Step::*known)() const, const auto& value) -> Json {
      if (!model_.has(known)) return nullptr;
      return curve(grid, [&](Index k) { return double(value(model_.at(k))); });
    };
    json_["per_step"] = {
        {"x", grid.x},
        {"stretch", grid.stretch},
        {"condition", list(&Step::has_condition, [](const Step& step) { return step.condition(); })},
        {"rank", list(&Step::has_rank, [](const Step& step) { return step.rank(); })},
        {"unknowns",
         !model_.has(&Step::has_lags) ? Json() : curve(grid, [&](Index k) { return double(unknowns(model_, k)); })},
        {"lags", list(&Step::has_lags, [](const Step& step) { return step.lags(); })},
        {"states", curve(grid, [&](Index k) { return double(model_.n(k)); })}};
    const Grid whole = make_grid(0, data_.steps(), options_.points);
    json_["step_error"] = {{"x", whole.x},
                           {"stretch", whole.stretch},
                           {"value", curve(whole, [&](Index k) { return found_.step_error[size_t(k)]; })}};
  }

  void poles() {
    const Framed& frame = plots_.frame;
    const Model& model = frame.model;
    std::vector<Eigen::VectorXcd> open, closed;
    Index mixed = 0, infinite = 0;
    for (Index k = model.k_begin; k < model.k_end(); ++k) {
      const bool square = model.n(k) == model.n(k + 1) && model.n(k) > 0;
      if (!square || k < frame.begin || k >= frame.end) {
        ++mixed;
        continue;
      }
      Eigen::VectorXcd of_a = linalg::eigenvalues(model.at(k).A());
      Eigen::VectorXcd of_observer = linalg::eigenvalues(model.at(k).closed_loop());
      if (!of_a.allFinite() || !of_observer.allFinite()) {
        ++infinite;
        continue;
      }
      plots_.radius.push_back({k, of_a.cwiseAbs().maxCoeff(), of_observer.cwiseAbs().maxCoeff()});
      open.push_back(std::move(of_a));
      closed.push_back(std::move(of_observer));
    }
    const auto steps = [](Index count) { return count == 1 ? "one step" : fmt::format("{} steps", count); };
    if (mixed > 0 && model.states() > 0)
      omit("Eigenvalues are not shown at {}: the state dimension changes there, or the {} frame does not reach them.",
           steps(mixed), frame.name);
    if (infinite > 0)
      omit("Eigenvalues are not shown at {}: the eigenvalues of A or A + GC are not finite there.", steps(infinite));

    // If there are too many steps, each stretch shows two steps: the one with the largest eigenvalue of A, and the one
    // with the largest eigenvalue of A + GC.
    const Index count = Index(plots_.radius.size());
    const Index most = std::max<Index>(2, most_poles / std::max<Index>(1, 4 * model.states()));
    const Index stride = count <= most ? 1 : (2 * count + most - 1) / most;
    if (stride > 1)
      omit(
          "Of every {} steps, the eigenvalues of two are drawn: those with the largest eigenvalue of A, and of A + GC.",
          stride);
    const auto farther = [](double Radius::*size) {
      return [size](const Radius& a, const Radius& b) { return a.*size < b.*size; };
    };
    Json k_list = Json::array(), open_list = Json::array(), closed_list = Json::array();
    const auto list = [](const Eigen::VectorXcd& values) {
      Json numbers = Json::array();
      for (const auto& value : values) {
        numbers.push_back(rounded(value.real()));
        numbers.push_back(rounded(value.imag()));
      }
      return numbers;
    };
    for (Index i = 0; i < count; i += stride) {
      const auto begin = plots_.radius.begin(), from = begin + i, to = begin + std::min(count, i + stride);
      std::set<Index> shown;
      for (const auto size : {&Radius::open, &Radius::closed})
        shown.insert(std::max_element(from, to, farther(size)) - begin);
      for (const Index at : shown) {
        k_list.push_back(plots_.radius[size_t(at)].k);
        open_list.push_back(list(open[size_t(at)]));
        closed_list.push_back(list(closed[size_t(at)]));
      }
    }
    json_["poles"] = {
        {"frame", frame.name}, {"stride", stride}, {"k", k_list}, {"open", open_list}, {"closed", closed_list}};
  }

  // The entries of A_k or G_k over k; NaN where a matrix is too small to have the entry.
  Json entries_of(const Model& model, Step::View (Step::*matrix)() const, Index begin, Index end, Index rows,
                  Index cols, const char* what) {
    const Index shown_rows = std::min(rows, most_states_shown), shown_cols = std::min(cols, most_states_shown);
    if (shown_rows < rows || shown_cols < cols)
      omit("Of {} the first {} × {} entries of {} × {} are drawn.", what, shown_rows, shown_cols, rows, cols);
    const Grid grid =
        make_grid(begin, std::max<Index>(0, end - begin), points_for(shown_rows * shown_cols, most_entry_numbers));
    Json values = Json::array();
    for (Index i = 0; i < shown_rows; ++i)
      for (Index j = 0; j < shown_cols; ++j)
        values.push_back(curve(grid, [&](Index k) {
          const Step::View a = (model.at(k).*matrix)();
          return i < a.rows() && j < a.cols() ? a(i, j) : nan;
        }));
    return {{"x", grid.x}, {"stretch", grid.stretch}, {"rows", shown_rows}, {"cols", shown_cols}, {"values", values}};
  }

  void entries() {
    const Framed& frame = plots_.frame;
    const Index n = model_.states();
    json_["gain"] = entries_of(frame.model, &Step::G, frame.begin, frame.end, n, model_.outputs, "the gains");
    json_["gain"]["frame"] = frame.name;
    const Model smooth =
        model_.frame == "smooth" || frame.name == "smooth"
            ? (frame.name == "smooth" ? frame.model : model_)
            : smooth_frame(model_, std::max(model_.max_lags(), (n + model_.outputs - 1) / model_.outputs));
    json_["A"] = entries_of(smooth, &Step::A, model_.k_begin, model_.k_end(), n, n, "A");
  }

  // For each start, output and input: a list of numbers. Column j + m·i has output j for input i. null without values.
  Json response_lists(const std::vector<Matrix>& all, Index outputs, Index inputs) const {
    Json starts = Json::array();
    for (const Matrix& values : all) {
      if (values.size() == 0) {
        starts.push_back(nullptr);
        continue;
      }
      Json pairs = Json::array();
      for (Index i = 0; i < inputs; ++i)
        for (Index j = 0; j < outputs; ++j) {
          const Vector column = values.col(j + model_.outputs * i);
          pairs.push_back(rounded(std::vector<double>(column.begin(), column.end())));
        }
      starts.push_back(std::move(pairs));
    }
    return starts;
  }

  // The channels of the responses on the page.
  std::pair<Index, Index> response_channels() {
    const Index outputs = std::min(model_.outputs, most_response_channels);
    const Index inputs = std::min(model_.inputs, most_response_channels);
    if (outputs < model_.outputs || inputs < model_.inputs)
      omit("The responses are drawn for {} of {} outputs and {} of {} inputs.", outputs, model_.outputs, inputs,
           model_.inputs);
    return {outputs, inputs};
  }

  void responses() {
    json_["responses"] = nullptr;
    if (model_.inputs == 0) return;
    const auto [outputs, inputs] = response_channels();
    const std::vector<Index> starts = response_starts(model_, options_.at);
    const Index length = response_length(model_);
    const Responses found = report::responses(model_, starts, length);
    Json others = Json::array();
    for (size_t i = 0; i < std::min(options_.compare.size(), size_t(most_compared_models)); ++i) {
      const Responses theirs = report::responses(options_.compare[i].model, starts, length);
      others.push_back({{"pulse", response_lists(theirs.pulse, outputs, inputs)},
                        {"step", response_lists(theirs.step, outputs, inputs)}});
    }
    Json list{{"starts", found.starts},
              {"length", found.length},
              {"outputs", outputs},
              {"inputs", inputs},
              {"pulse", response_lists(found.pulse, outputs, inputs)},
              {"step", response_lists(found.step, outputs, inputs)},
              {"others", others},
              {"bands", nullptr}};
    if (const std::optional<ResponseBands>& bands = options_.bands) {
      const Index columns = model_.outputs * model_.inputs;
      const auto fits = [&](const std::vector<Matrix>& all) {
        return all.size() == found.starts.size() && std::all_of(all.begin(), all.end(), [&](const Matrix& values) {
                 return values.rows() == found.length && values.cols() == columns;
               });
      };
      if (bands->starts != found.starts || !fits(bands->pulse_lower) || !fits(bands->pulse_upper) ||
          !fits(bands->step_lower) || !fits(bands->step_upper) || !same_responses(bands->pulse, found.pulse) ||
          !same_responses(bands->step, found.step))
        throw std::invalid_argument(wrong_bands);
      list["bands"] = {{"level", bands->level},
                       {"pulse_lower", response_lists(bands->pulse_lower, outputs, inputs)},
                       {"pulse_upper", response_lists(bands->pulse_upper, outputs, inputs)},
                       {"step_lower", response_lists(bands->step_lower, outputs, inputs)},
                       {"step_upper", response_lists(bands->step_upper, outputs, inputs)}};
    }
    json_["responses"] = std::move(list);
  }

  // The number of other models in the plots.
  Index compared_models() const { return std::min<Index>(Index(options_.compare.size()), most_compared_models); }

  // Natural frequencies [rad/s] and damping ratios of the modes over time, with one curve where a mode is valid and one
  // where it is not. A conjugate pair is one mode.
  void modes_over_time() {
    plots_.modes = modes_of_page(model_);
    json_["modes"] = nullptr;
    if (!plots_.modes) return;
    const Modes& found = *plots_.modes;
    for (Index i = 0; i < compared_models(); ++i)
      modes_of_compared_.push_back(modes_of_page(options_.compare[size_t(i)].model));
    const Matrix frequency = natural_frequencies(found), damping = damping_ratios(found);
    const Index count = std::min(found.count(), most_modes);
    if (count < found.count()) omit("Of {} modes the slowest {} are drawn.", found.count(), count);
    const Grid grid =
        make_grid(found.begin, found.steps(), points_for((4 + 2 * compared_models()) * count, most_mode_numbers));
    Json list = Json::array();
    for (Index i = 0; i < count; ++i) {
      const auto part = [&](const Matrix& values, bool valid) {
        return curve(grid, [&](Index step) {
          const Index k = step - found.begin;
          return found.leads(k, i) && found.valid(k, i) == valid ? values(k, i) : nan;
        });
      };
      if ((found.poles.col(i).imag().array() < 0).all()) continue;  // the second one of a pair
      list.push_back({{"mode", i + 1},
                      {"frequency", part(frequency, true)},
                      {"other_frequency", part(frequency, false)},
                      {"damping", part(damping, true)},
                      {"other_damping", part(damping, false)}});
    }
    json_["modes"] = {{"x", grid.x}, {"stretch", grid.stretch}, {"modes", list}, {"others", modes_of_others(grid)}};
  }

  // The valid modes of the other models at the same steps.
  Json modes_of_others(const Grid& grid) const {
    Json others = Json::array();
    for (size_t i = 0; i < modes_of_compared_.size(); ++i)
      others.push_back(modes_of_compared_[i] ? drawn_modes(options_.compare[i].model, *modes_of_compared_[i], grid)
                                             : Json::array());
    return others;
  }

  Json drawn_modes(const Model& model, const Modes& found, const Grid& grid) const {
    Json list = Json::array();
    const Matrix frequencies = natural_frequencies(found), dampings = damping_ratios(found);
    for (Index mode = 0; mode < std::min(found.count(), most_modes); ++mode) {
      const auto part = [&](const Matrix& values) {
        return curve(grid, [&](Index step) {
          const Index k = row_of(model, found, step);
          return k >= 0 && found.leads(k, mode) && found.valid(k, mode) ? values(k, mode) : nan;
        });
      };
      Json frequency = part(frequencies);
      if (std::all_of(frequency.begin(), frequency.end(), [](const Json& value) { return value.is_null(); })) continue;
      list.push_back({{"frequency", std::move(frequency)}, {"damping", part(dampings)}});
    }
    return list;
  }

  // Magnitude and phase [degrees] of the frozen frequency responses, also of the other models.
  void frozen() {
    json_["frozen"] = nullptr;
    if (model_.inputs == 0 || !plots_.modes) return;
    plots_.frozen = frozen_responses(model_, *plots_.modes, options_.at);
    const FrozenResponses& found = plots_.frozen;
    const FrozenCurves own = frozen_curves(found.response);
    check_frozen_bands(own);
    if (found.steps.empty()) return;
    const Index outputs = std::min(model_.outputs, most_response_channels);
    const Index inputs = std::min(model_.inputs, most_response_channels);
    const auto lists = [&](const std::vector<Matrix>& all) { return response_lists(all, outputs, inputs); };
    Json others = Json::array();
    for (size_t i = 0; i < modes_of_compared_.size(); ++i) {
      FrozenCurves theirs =
          frozen_curves(frozen_responses_of(options_.compare[i].model, modes_of_compared_[i], found, model_.dt));
      for (size_t s = 0; s < theirs.phase.size(); ++s) begin_near(theirs.phase[s], own.phase[s]);
      others.push_back({{"magnitude", lists(theirs.magnitude)}, {"phase", lists(degrees(std::move(theirs.phase)))}});
    }
    json_["frozen"] = {
        {"steps", found.steps},
        {"timed", model_.provenance.dt_stated},
        {"frequencies", rounded(std::vector<double>(found.frequencies.begin(), found.frequencies.end()))},
        {"outputs", outputs},
        {"magnitude", lists(own.magnitude)},
        {"phase", lists(degrees(own.phase))},
        {"others", others},
        {"bands", nullptr}};
    if (const std::optional<ResponseBands>& bands = options_.bands)
      json_["frozen"]["bands"] = {{"level", bands->level},
                                  {"magnitude_lower", lists(bands->magnitude_lower)},
                                  {"magnitude_upper", lists(bands->magnitude_upper)},
                                  {"phase_lower", lists(degrees(bands->phase_lower))},
                                  {"phase_upper", lists(degrees(bands->phase_upper))}};
  }

  static std::vector<Matrix> degrees(std::vector<Matrix> phases) {
    for (Matrix& phase : phases) phase *= 180 / std::numbers::pi;
    return phases;
  }

  // Moves each phase by whole turns, so that it begins near the other one.
  static void begin_near(Matrix& phase, const Matrix& own) {
    constexpr double turn = 2 * std::numbers::pi;
    for (Index c = 0; c < phase.cols(); ++c)
      if (const double turns = std::round((phase(0, c) - own(0, c)) / turn); std::isfinite(turns))
        phase.col(c).array() -= turns * turn;
  }

  // \throws std::invalid_argument unless the bands, if there are any, belong to these responses
  void check_frozen_bands(const FrozenCurves& own) const {
    if (!options_.bands) return;
    const ResponseBands& bands = *options_.bands;
    const auto fits = [&](const std::vector<Matrix>& all) {
      return all.size() == own.phase.size() &&
             std::equal(all.begin(), all.end(), own.phase.begin(),
                        [](const Matrix& a, const Matrix& b) { return a.rows() == b.rows() && a.cols() == b.cols(); });
    };
    if (bands.frozen_steps != plots_.frozen.steps || !fits(bands.magnitude_lower) || !fits(bands.magnitude_upper) ||
        !fits(bands.phase_lower) || !fits(bands.phase_upper) || !fits(bands.magnitude) || !fits(bands.phase) ||
        !same_responses({bands.frequencies}, {plots_.frozen.frequencies}) ||
        !same_responses(parts_of(bands.magnitude, bands.phase), parts_of(own.magnitude, own.phase)))
      throw std::invalid_argument(wrong_bands);
  }

  void whiteness() {
    const Whiteness& white = found_.validation.whiteness;
    json_["whiteness"] = nullptr;
    if (white.correlation.rows() == 0 || std::isnan(white.p)) return;
    Json correlation = Json::array();
    for (Index j = 0; j < white.correlation.cols(); ++j) {
      const Vector column = white.correlation.col(j);
      correlation.push_back(rounded(std::vector<double>(column.begin(), column.end())));
    }
    json_["whiteness"] = {{"correlation", correlation},
                          {"bound", rounded(std::vector<double>(white.bound.begin(), white.bound.end()))}};
  }

  // For each input, the correlations of each output's innovations with it, over the lags.
  void input_correlation() {
    const InputCorrelation& found = found_.input_correlation;
    json_["input_correlation"] = nullptr;
    if (found.over == Pooling::none || model_.inputs == 0) return;
    const Index inputs = std::min(model_.inputs, most_correlated_inputs);
    const Index outputs = std::min(model_.outputs, most_correlated_outputs);
    if (inputs < model_.inputs || outputs < model_.outputs)
      omit("The correlations with the inputs are drawn for {} of {} inputs and {} of {} outputs.", inputs,
           model_.inputs, outputs, model_.outputs);
    Json list = Json::array();
    for (Index i = 0; i < inputs; ++i) {
      Json correlation = Json::array(), bound = Json::array();
      for (Index j = 0; j < outputs; ++j) {
        Json lags = Json::array();
        for (const Matrix& lag : found.correlation) lags.push_back(rounded(lag(j, i)));
        correlation.push_back(std::move(lags));
      }
      for (Index lag = 0; lag < found.bound.rows(); ++lag) bound.push_back(rounded(found.bound(lag, i)));
      list.push_back({{"correlation", correlation}, {"bound", bound}});
    }
    json_["input_correlation"] = {{"first", found.first}, {"inputs", list}};
  }

  void findings() {
    json_["conclusions"] = json_of(found_.conclusions);
    json_["findings"] = Json::array();
    for (Finding finding : found_.findings) {
      if (finding.steps.size() > most_finding_steps) {
        omit("Of the {} steps of a finding the first {} are in the data of the page.", finding.steps.size(),
             most_finding_steps);
        finding.steps.resize(most_finding_steps);
      }
      json_["findings"].push_back(json_of(finding));
    }
  }

  void checks(const Verdict& verdict) {
    json_["verdict"] = json_of(verdict);
    json_["checks"] = json_of(verdict.checks);
  }

  const Model& model_;
  const Ensemble& data_;
  const Evidence& found_;
  const ModelComparison& comparison_;
  const ReportOptions& options_;
  Plots plots_;
  // modes_of_page() of each other model in the plots; no elements if the model itself has no modes
  std::vector<std::optional<Modes>> modes_of_compared_;
  Json json_;
};

}  // namespace

Plots plot_data(const Model& model, const Ensemble& data, const Evidence& found, const Verdict& verdict,
                const ModelComparison& comparison, const ReportOptions& options) {
  return Collector(model, data, found, comparison, options).collect(verdict);
}

}  // namespace tokid::report
