// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/deploy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "base/words.hpp"
#include "deploy/source.hpp"
#include "deploy/tables.hpp"
#include "model/continuation.hpp"
#include "model/observer_rows.hpp"
#include "tokid/io.hpp"
#include "tokid/linalg.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace c_code {

namespace {

// The steps k = 0 … end-1 of the tables. After the last one the tables begin again at end - period.
struct Rows {
  Index begin = 0, end = 0;  // the model has the steps from `begin` on
  Index period = 0;          // 0: the model ends
  bool nominal = false;      // has the model a nominal trajectory?
};

Rows rows_of(const Model& model) {
  Rows rows{model.k_begin, model.k_end(), goes_on(model) ? model.period : 0, model.u_nominal.rows() > 0};
  const Index known = model.u_nominal.rows();
  // A periodic model has a nominal trajectory that may begin to repeat later, or end.
  if (rows.period > 0) rows.end = std::max(rows.end, known < rows.period && known > 0 ? known + rows.period : known);
  return rows;
}

constexpr const char* name_rule = "a letter, then letters, digits and '_', in all at most 64,";

bool is_name(const std::string& name) {
  const auto letter = [](char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; };
  const auto part = [&](char c) { return letter(c) || c == '_' || std::isdigit(static_cast<unsigned char>(c)) != 0; };
  return !name.empty() && name.size() <= 64 && letter(name.front()) && std::all_of(name.begin(), name.end(), part);
}

void check_model(const Model& model, const Rows& rows) {
  constexpr Index most = 10'000'000;  // the nominal trajectory has a row for each step from step 0 on
  model.check();
  if (model.steps() == 0) throw std::invalid_argument("model: no step found, at least one needed");
  if (rows.end > most)
    throw std::invalid_argument(
        fmt::format("model: last step {} found, at most {} needed for tables of all steps", rows.end - 1, most - 1));
}

// The code has one nominal trajectory.
void check_nominal(const Controller& controller, const Model& model) {
  for (Index k = controller.begin; k < controller.end(); ++k) {
    const auto own = controller.u_nominal.row(k - controller.begin);
    const Index row = nominal_row(model, model.u_nominal, k);
    if (row < 0 ? !own.isZero(0) : own != model.u_nominal.row(row))
      throw std::invalid_argument(
          fmt::format("controller: another nominal input found at step {}, that of the model needed", k));
  }
}

void append_rows(const Matrix& matrix, std::vector<double>& block) {
  for (Index i = 0; i < matrix.rows(); ++i)
    for (Index j = 0; j < matrix.cols(); ++j) block.push_back(matrix(i, j));
}

// The rows of [C D] and of [A B -G], which multiply [x; u] and [x; u; e].
std::vector<double> system_block(const Step& step) {
  const Index n = step.states(), next = step.next_states(), r = step.inputs(), m = step.outputs();
  Matrix output(m, n + r), transition(next, n + r + m);
  output << step.C(), step.D();
  transition << step.A(), step.B(), -step.G();
  std::vector<double> block;
  append_rows(output, block);
  append_rows(transition, block);
  return block;
}

// Standard deviations of the innovations, then the rows of a lower triangular F, of which F Fᵀ is their correlation
// matrix. So units cancel, and float keeps correlations near one apart. As in OnlineObserver, the size of rounding
// errors, here those of the code, is added to the diagonal first.
std::vector<double> covariance_block(const Step& step, Index k, double epsilon) {
  const Index m = step.outputs();
  const std::optional<Matrix> root = linalg::covariance_factor(step.innovation_cov());
  if (!root)
    throw std::invalid_argument(fmt::format(
        "model: innovation_cov is no covariance at step {}; a symmetric matrix without negative eigenvalues needed",
        k));
  const Vector deviation = step.innovation_cov().diagonal().cwiseSqrt();
  Matrix raised(m + m, m);  // raisedᵀ·raised is the correlation matrix with the raised diagonal
  raised.topRows(m) = root->transpose() * (deviation.array() > 0).select(deviation.cwiseInverse(), 0.0).asDiagonal();
  raised.bottomRows(m) = std::sqrt(epsilon * double(m)) * Matrix::Identity(m, m);
  const Matrix upper = linalg::triangular_factor(raised);
  std::vector<double> block(deviation.begin(), deviation.end());
  for (Index i = 0; i < m; ++i)
    for (Index l = 0; l <= i; ++l) block.push_back(upper(l, i));
  return block;
}

std::vector<double> nominal_block(const Model& model, Index k) {
  std::vector<double> block;
  for (const Matrix* trajectory : {&model.u_nominal, &model.y_nominal}) {
    const Index row = nominal_row(model, *trajectory, k);
    append_rows(row < 0 ? Matrix(Matrix::Zero(1, trajectory->cols())) : Matrix(trajectory->row(row)), block);
  }
  return block;
}

// For each input: the feedforward, if there is one, and the rows of -K and -L.
std::vector<double> law_block(const Controller& controller, size_t s) {
  std::vector<double> block;
  for (Index i = 0; i < controller.K[s].rows(); ++i) {
    if (controller.feedforward.size() > 0) block.push_back(controller.feedforward(Index(s), i));
    append_rows(-controller.K[s].row(i), block);
    if (!controller.L.empty()) append_rows(-controller.L[s].row(i), block);
  }
  return block;
}

Operations step_operations(const Model& model, bool nominal) {
  const Index r = model.inputs, m = model.outputs;
  Index products = 0;
  for (const Step& step : model.step) {
    const Index n = step.states();
    products = std::max(products, m * (n + r) + step.next_states() * (n + r + m));
  }
  return {products, products + m + (nominal ? r + 2 * m : 0), 0};
}

// Most operations of estimate_missing() with o available outputs of m. The rows of F become longer from output to
// output, so most are needed if the last o outputs are available.
Operations missing_operations(Index o, Index m) {
  Operations count;
  const auto products = [&](Index length) {
    count.multiplications += length;
    count.additions += length;
  };
  for (Index i = 0; i < m; ++i) {
    if (i < m - o) {
      products(i + 1);
      ++count.multiplications;
      continue;
    }
    for (Index j = m - o; j < i; ++j) products(2 * (j + 1));
    products(3 * (i + 1));
    ++count.additions;
    count.divisions += i - (m - o) + 2;
  }
  return count;
}

Operations with_missing(Operations step, Index m) {
  Operations most;
  for (Index o = 0; o < m; ++o) {
    const Operations count = missing_operations(o, m);
    most.multiplications = std::max(most.multiplications, count.multiplications);
    most.additions = std::max(most.additions, count.additions);
    most.divisions = std::max(most.divisions, count.divisions);
  }
  return {step.multiplications + most.multiplications, step.additions + most.additions,
          step.divisions + most.divisions};
}

Operations control_operations(const Controller& controller, bool nominal) {
  Index products = 0;
  const Index r = controller.u_nominal.cols();
  for (const Matrix& K : controller.K) products = std::max(products, r * (K.cols() + (controller.L.empty() ? 0 : r)));
  return {products, products + (nominal ? r : 0), 0};
}

std::string channel_lines(const char* symbol, const std::vector<std::string>& names,
                          const std::vector<std::string>& units) {
  std::string lines;
  for (size_t i = 0; i < names.size(); ++i) {
    const std::string unit = comment_text(units[i]);
    lines += fmt::format(" *   {}[{}]  {}{}\n", symbol, i, comment_text(names[i]),
                         unit.empty() ? "" : fmt::format(" [{}]", unit));
  }
  return lines;
}

std::string description(const Model& model, const Rows& rows, const Vector& start, bool known) {
  std::string text =
      fmt::format(" * Model: n = {} states, r = {} inputs, m = {} outputs, steps {} to {}, dt = {} s.\n",
                  model.states(), model.inputs, model.outputs, model.k_begin, model.k_end() - 1, model.dt);
  if (rows.period == 1)
    text += " * Its matrices do not change from the last step on, and the observer runs on without end.\n";
  else if (rows.period > 1)
    text += fmt::format(" * It repeats itself every {} steps, and the observer runs on without end.\n", rows.period);
  const bool varies = std::any_of(model.step.begin(), model.step.end(), [&](const Step& step) {
    return step.states() != model.states() || step.next_states() != model.states();
  });
  if (varies)
    text +=
        " * The number of states varies from step to step: before step k, the first n_k numbers of x are the state.\n"
        " * The matrices lie in the tables without padding, and a further table says where those of a step begin.\n";
  if (!known)
    text += fmt::format(
        " * The initial state at step {} is unknown. The observer starts from zero, so its first predictions are\n"
        " * wrong. Their error decays as the observer does.\n",
        model.k_begin);
  else if (start.isZero(0))
    text += fmt::format(" * The state at step {} is zero.\n", model.k_begin);
  else
    text += fmt::format(" * The state at step {} is the mean of the initial states of the model.\n", model.k_begin);
  return text;
}

std::string checked_name(const DeployOptions& options) {
  const std::string name = options.name.empty() ? "observer" : options.name;
  if (!is_name(name)) throw std::invalid_argument(fmt::format("name: '{}' found, {} needed", name, name_rule));
  return name;
}

// The state at the first step; nothing if the observer starts from zero because it is unknown.
std::optional<Vector> checked_start(const Model& model, const DeployOptions& options) {
  std::optional<Vector> known = observer::known_start(model, model.initial_state, true);
  if (!known && !options.start_from_zero)
    throw std::invalid_argument(fmt::format(
        "model: an unknown initial state at step {} found, a known one or x0_mean needed. With start_from_zero the "
        "observer starts from zero, and its first predictions are wrong",
        model.k_begin));
  return known;
}

double epsilon_of(const DeployOptions& options) {
  return options.single_precision ? double(std::numeric_limits<float>::epsilon())
                                  : std::numeric_limits<double>::epsilon();
}

// Does the controller use the last input?
bool holds_inputs(const Controller* controller) { return controller && !controller->L.empty(); }

// The numbers of the tables.
struct Contents {
  Blocks systems, covariances, nominals, laws;
  std::vector<Index> states;  // before each step, and after the last
  bool estimates = false;     // are the innovations of missing outputs estimated?
};

Contents contents_of(const Model& model, const Rows& rows, const Controller* controller, double epsilon) {
  Contents contents;
  contents.estimates = model.outputs > 1 && model.has(&Step::has_innovation_cov);
  for (Index k = rows.begin; k < rows.end; ++k) {
    const Step& step = step_at(model, k);
    contents.systems.add(system_block(step));
    contents.states.push_back(step.states());
    if (contents.estimates) contents.covariances.add(covariance_block(step, k, epsilon));
  }
  contents.states.push_back(step_at(model, rows.end - 1).next_states());
  for (Index k = 0; rows.nominal && k < rows.end; ++k) contents.nominals.add(nominal_block(model, k));
  for (size_t s = 0; controller && s < controller->K.size(); ++s) contents.laws.add(law_block(*controller, s));
  return contents;
}

// The largest number of states, at least one: C has no empty arrays.
Index array_length(const Model& model) { return std::max<Index>(model.states(), 1); }

Words words_of(const std::string& name, const Model& model, const DeployOptions& options, const Rows& rows,
               const Vector& start) {
  return {{"name", name},
          {"guard", "TOKID_" + name + "_H"},  // as it is spelled, because C tells plant and Plant apart
          {"file", options.header.empty() ? name + ".h" : options.header},
          {"version", version},
          {"real", options.single_precision ? "float" : "double"},
          {"limit", options.single_precision ? "FLT" : "DBL"},
          {"n", fmt::format("{}", array_length(model))},
          {"states_n", fmt::format("{}", model.states())},
          {"r", fmt::format("{}", model.inputs)},
          {"m", fmt::format("{}", model.outputs)},
          {"begin", fmt::format("{}u", rows.begin)},
          {"end", fmt::format("{}u", rows.end)},
          {"period", fmt::format("{}u", rows.period)},
          {"n0", fmt::format("{}", start.size())}};
}

// Adds the tables, and the words by which the code finds its numbers in them.
void place_tables(Tables& tables, Words& words, const Contents& contents, const Rows& rows,
                  const Controller* controller) {
  const std::string count =
      tables.lookup("states_of", "number of states before each step, and after the last", contents.states, "@row@");
  words["states"] = filled(count, {{"row", "step"}});
  words["next_states"] = filled(count, {{"row", "(step + 1)"}});
  words["system"] =
      tables.place("systems", "of each step the rows of [C D], then those of [A B -G]", contents.systems, "step");
  if (rows.nominal)
    words["nominal"] =
        tables.place("nominals", "of each step the nominal inputs, then the nominal outputs", contents.nominals, "row");
  if (contents.estimates)
    words["covariance"] = tables.place(
        "covariances",
        "of each step the standard deviations of the innovations, then the lower triangular root of their correlations",
        contents.covariances, "step");
  if (!controller) return;
  words["law"] = tables.place("laws", law_comment(controller->feedforward.size() > 0, holds_inputs(controller)),
                              contents.laws, "step");
  words["control_begin"] = fmt::format("{}u", controller->begin);
  words["control_end"] = fmt::format("{}u", controller->end());
  words["control_first"] = fmt::format("{}", controller->begin);
  words["control_last"] = fmt::format("{}", controller->end() - 1);
}

void count_sizes(DeployedCode& code, const Model& model, const DeployOptions& options, const Rows& rows,
                 const Contents& contents, const Tables& tables, const Controller* controller) {
  const Index size = options.single_precision ? 4 : 8, held = holds_inputs(controller) ? model.inputs : 0;
  code.stored_steps = contents.systems.count();
  code.table_bytes = tables.bytes();
  code.state_bytes = size * (array_length(model) + held) + 8;
  code.step = step_operations(model, rows.nominal);
  code.step_missing = contents.estimates ? with_missing(code.step, model.outputs) : code.step;
  if (controller) code.control = control_operations(*controller, rows.nominal);
}

// 20 (n + r + m) ε max(1, ‖C‖) with the largest absolute row sum ‖C‖. A prediction has n + r products, and a new state
// n + r + m, each with an error of ε of the terms. If state errors decay by 5 % in each step, those of all steps sum up
// to 1/(1 - 0.95) = 20 times the errors of one.
double rounding_share(const Model& model, double epsilon) {
  double norm = 1.0;
  for (const Step& step : model.step)
    if (step.C().size() > 0) norm = std::max(norm, step.C().cwiseAbs().rowwise().sum().maxCoeff());
  return 20 * double(model.states() + model.inputs + model.outputs) * epsilon * norm;
}

// Does the model meet the condition of rounding_share()? The sentence about it.
std::string sentence_of_decay(const Model& model) {
  double largest = 0.0;
  for (const Step& step : model.step) {
    const Matrix loop = step.closed_loop();
    if (loop.size() == 0) continue;
    largest = loop.allFinite() ? std::max(largest, linalg::singular_values(loop)(0))
                               : std::numeric_limits<double>::infinity();
    if (std::isinf(largest)) break;
  }
  if (largest <= 0.95 * (1 + 1e-12))
    return fmt::format("This model meets it: the largest |A + G C| is {:.2g}.", largest);
  return fmt::format(
      "This model does not meet it: the largest |A + G C| is\n * {:.3g}. Rounding errors may therefore exceed the bound.",
      largest);
}

// The words of the comment in the header.
void describe_code(Words& words, const DeployedCode& code, const Model& model, const Rows& rows, const Vector& start,
                   bool known, double epsilon) {
  const Channels names = complete(model.names, model.inputs, model.outputs);
  words["channels"] = channel_lines("u", names.input_names, names.input_units) +
                      channel_lines("y", names.output_names, names.output_units);
  words["description"] = description(model, rows, start, known);
  words["stored"] = tokid::words::plural(code.stored_steps, "different step");
  words["table_bytes"] = fmt::format("{}", code.table_bytes);
  words["state_bytes"] = fmt::format("{}", code.state_bytes);
  words["operations"] = in_words(code.step);
  words["operations_missing"] = in_words(code.step_missing);
  words["operations_control"] = in_words(code.control);
  words["decay"] = sentence_of_decay(model);
  words["rounding"] = fmt::format("{:.1e}", rounding_share(model, epsilon));
}

}  // namespace

}  // namespace c_code

std::string in_words(const Operations& count) {
  std::string text = fmt::format("{} multiplications, {} additions", count.multiplications, count.additions);
  if (count.divisions > 0) text += ", " + words::plural(count.divisions, "division");
  return text;
}

DeployedCode deploy(const Model& model, const DeployOptions& options, const Controller* controller) {
  using namespace tokid::c_code;
  const std::string name = checked_name(options);
  const Rows rows = rows_of(model);
  check_model(model, rows);
  if (controller) {
    controller->check(model);
    check_nominal(*controller, model);
  }
  const std::optional<Vector> known = checked_start(model, options);
  const Vector start = known ? *known : Vector::Zero(model.n(model.k_begin));
  const Contents contents = contents_of(model, rows, controller, epsilon_of(options));

  Tables tables(options.single_precision);
  Words words = words_of(name, model, options, rows, start);
  place_tables(tables, words, contents, rows, controller);
  if (!start.isZero(0)) tables.numbers("start", "state at the first step", {{start.begin(), start.end()}});

  DeployedCode code;
  code.name = name;
  count_sizes(code, model, options, rows, contents, tables, controller);
  describe_code(words, code, model, rows, start, known.has_value(), epsilon_of(options));
  words["tables"] = tables.text();
  const Features features{.nominal = rows.nominal,
                          .estimates = contents.estimates,
                          .begins = rows.begin > 0,
                          .period = rows.period > 0,
                          .start = !start.isZero(0),
                          .controller = controller != nullptr,
                          .held = holds_inputs(controller),
                          .feedforward = controller && controller->feedforward.size() > 0,
                          .control_later = controller && controller->begin > 0};
  code.header = header_text(words, features);
  code.source = source_text(words, features);
  return code;
}

std::filesystem::path deployed_header(const std::filesystem::path& source) {
  const std::string stem = source.stem().string();
  if (source.extension() != ".c")
    throw IoError(
        fmt::format("{}: extension '{}' found, .c needed to write C", source.string(), source.extension().string()));
  const auto plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-' || c == '.';
  };
  if (stem.empty() || !std::all_of(stem.begin(), stem.end(), plain))
    throw IoError(fmt::format("{}: a name that #include may not accept found, letters, digits, '_', '-' and '.' needed",
                              source.string()));
  return std::filesystem::path(source).replace_extension(".h");
}

DeployedCode save_deployed(const Model& model, const std::filesystem::path& source, DeployOptions options,
                           const Controller* controller) {
  const std::filesystem::path header = deployed_header(source);
  if (options.name.empty()) {
    options.name = source.stem().string();
    if (!c_code::is_name(options.name))
      throw std::invalid_argument(
          fmt::format("name: '{}' found, which is that of the file, {} needed. State another name", options.name,
                      c_code::name_rule));
  }
  options.header = header.filename().string();
  DeployedCode code = deploy(model, options, controller);
  FilesTogether files;
  save_text(code.header, header);
  save_text(code.source, source);
  files.commit();
  return code;
}

}  // namespace tokid
