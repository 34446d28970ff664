// SPDX-License-Identifier: BSD-3-Clause
#include "excitation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "combination.hpp"
#include "words.hpp"

namespace tokid {

namespace {

// Terms that a message names; more are as good as none.
constexpr size_t most_terms = 4;
// Columns that a combination is looked for in: its time grows with their cube.
constexpr Index most_columns = 40;
// Steps that stand for all where nothing is wrong, and outputs that are looked at.
constexpr Index sampled_steps = 24, sampled_outputs = 16;
// Different combinations that are told.
constexpr size_t most_told = 4;
// Rows of a pooled record that are looked at: what holds for so many holds for all.
constexpr Index most_rows = 2000;

// Steps all over a range, at no regular distance: inputs may be held for a number of steps, or repeat.
std::vector<Index> spread(Index begin, Index end, Index count) {
  std::vector<Index> steps;
  constexpr double golden = 0.6180339887498949;
  if (end - begin <= count) count = std::max<Index>(0, end - begin);
  for (Index i = 0; i < count; ++i) {
    const double within = count == end - begin ? 0.0 : std::fmod(golden * double(i + 1), 1.0);
    steps.push_back(begin + Index((double(i) + within) * double(end - begin) / double(count)));
  }
  return steps;
}

// The samples before a group of steps that share a model, and those of the group itself.
class Inspection {
 public:
  Inspection(const Ensemble& e, const ExcitationOptions& o) : e_(e), o_(o) {}

  struct Found {
    std::vector<std::pair<std::string, double>> terms;  // with the channel itself in front
    std::vector<std::string> channels;                  // inputs of the same step that take part
    bool feedback = false, constant = false;
  };

  // Do a few experiments allow for one among the inputs of a step? Where they do not, no more are looked at.
  bool may_be(Index k) const {
    const Index r = e_.inputs(), needed = r + 5, count = e_.experiments();
    few_.clear();
    Index rows = 0;
    for (Index i = 0; i < 3 * needed && rows < needed; ++i) {
      const auto u = e_.input(k).row(Index(i * count / (3 * needed) + i) % count);
      if (u.array().isNaN().any()) continue;
      few_.insert(few_.end(), u.begin(), u.end());
      ++rows;
    }
    if (rows < needed) return true;
    // Gram-Schmidt about the means, by columns.
    for (Index j = 0; j < r; ++j) {
      const auto at = [&](Index i, Index c) -> double& { return few_[size_t(i * r + c)]; };
      double mean = 0.0, before = 0.0, after = 0.0;
      for (Index i = 0; i < rows; ++i) mean += at(i, j) / double(rows);
      for (Index i = 0; i < rows; ++i) {
        at(i, j) -= mean;
        before += at(i, j) * at(i, j);
      }
      for (Index c = 0; c < j; ++c) {
        double product = 0.0;
        for (Index i = 0; i < rows; ++i) product += at(i, c) * at(i, j);
        for (Index i = 0; i < rows; ++i) at(i, j) -= product * at(i, c);
      }
      for (Index i = 0; i < rows; ++i) after += at(i, j) * at(i, j);
      if (!(after > 1e4 * nothing_left * nothing_left * before)) return true;
      for (Index i = 0; i < rows; ++i) at(i, j) /= std::sqrt(after);
    }
    return false;
  }

  // What the inputs of the steps are combinations of: of each other, or with the samples before.
  std::vector<Found> of(const std::vector<Index>& steps, bool with_past) const {
    const Index r = e_.inputs(), d = e_.channels();
    Index lags = with_past ? std::min(o_.lags, steps.front()) : 0;
    const auto width = [&](Index q) { return q * d + r + (o_.noisy && q > 0 ? e_.outputs() : 0); };
    while (lags > 0 && width(lags) > most_columns) --lags;
    Matrix rows = window(steps, lags, most_rows);
    while (lags > 0 && rows.rows() < width(lags) + 4) rows = window(steps, --lags, most_rows);
    std::vector<Found> found;
    if (with_past && lags == 0) return found;
    std::vector<Index> others;
    std::vector<std::string> names;
    // The newest first, which of equally good ones is taken.
    for (Index j = 1; j <= lags; ++j)
      for (Index c = 0; c < d; ++c) {
        others.push_back((lags - j) * d + c);
        names.push_back(fmt::format("{}(k-{})", channel(c), j));
      }
    if (o_.noisy && lags > 0)
      for (Index c = r; c < d; ++c) {
        others.push_back(lags * d + c);
        names.push_back(channel(c) + "(k)");
      }
    for (Index i = 0; i < r; ++i) {
      const auto own = rows.col(lags * d + i);
      const std::string name = with_past ? channel(i) + "(k)" : channel(i);
      if (const auto c = combination(rows(Eigen::all, others), own, o_.centred)) {
        Found f;
        f.constant = c->constant;
        f.terms.emplace_back(name, 1.0);
        f.channels.push_back(channel(i));
        for (const Combination::Term& t : c->terms) {
          const Index at = others[size_t(t.column)] % d;
          f.feedback = f.feedback || at >= r;
          if (!with_past) f.channels.push_back(channel(at));
          f.terms.emplace_back(names[size_t(t.column)], -t.factor);
        }
        if (!with_past) {  // in the order of the channels
          std::rotate(f.terms.begin(), f.terms.begin() + 1, f.terms.end());
          std::rotate(f.channels.begin(), f.channels.begin() + 1, f.channels.end());
        }
        found.push_back(std::move(f));
      } else if (!with_past) {
        others.push_back(i);
        names.push_back(name);
      }
    }
    return found;
  }

  std::string channel(Index c) const { return c < e_.inputs() ? e_.names.input(c) : e_.names.output(c - e_.inputs()); }

 private:
  // [v_{k-q} … v_k] of the experiments that have them, of so many spread over steps and experiments.
  Matrix window(const std::vector<Index>& steps, Index q, Index most) const {
    const Index all = Index(steps.size()) * e_.experiments(), looked = std::min(all, most),
                width = (q + 1) * e_.channels();
    Matrix result(looked, width);
    Index used = 0;
    for (Index i = 0; i < looked; ++i) {
      const Index at = Index(double(i) * double(all) / double(looked)), k = steps[size_t(at / e_.experiments())];
      if (k < q) continue;
      const Index n = at % e_.experiments(), from = (k - q) * e_.channels();
      bool whole = true;
      for (Index c = 0; c < width && whole; ++c) {
        result(used, c) = e_.samples()(n, from + c);
        whole = !std::isnan(result(used, c)) || (c >= width - e_.outputs() && !o_.noisy);
      }
      if (whole) ++used;
    }
    return result.topRows(used);
  }

  const Ensemble& e_;
  const ExcitationOptions& o_;
  mutable std::vector<double> few_;
};

// Steps at which one thing holds, whatever its numbers are.
struct Case {
  Inspection::Found found;
  std::string text;
  bool same = true;  // numbers at all steps
  std::vector<Index> steps;
};

class Cases {
 public:
  void add(Inspection::Found found, Index step) {
    std::string key;
    for (const auto& [name, factor] : found.terms) key += name + "|";
    if (found.terms.size() > most_terms) key = found.terms.front().first + "|…";
    const std::string text = sum_text(found.terms);
    Case& c = cases_[key];
    if (c.steps.empty()) {
      c.text = text;
      c.found = std::move(found);
    } else {
      c.same = c.same && text == c.text;
      c.found.constant = c.found.constant || found.constant;
    }
    if (c.steps.empty() || c.steps.back() != step) c.steps.push_back(step);
  }

  // Those of most steps first.
  std::vector<Case> most() const {
    std::vector<Case> list;
    for (const auto& [key, c] : cases_) list.push_back(c);
    std::stable_sort(list.begin(), list.end(),
                     [](const Case& a, const Case& b) { return a.steps.size() > b.steps.size(); });
    if (list.size() > most_told) list.resize(most_told);
    return list;
  }

 private:
  std::map<std::string, Case> cases_;
};

std::string listed(const std::vector<std::string>& names) {
  std::string text = names.front();
  for (size_t i = 1; i < names.size(); ++i) text += (i + 1 == names.size() ? " and " : ", ") + names[i];
  return text;
}

std::string combination_text(const Case& c) {
  const char* what = c.found.constant ? "constant" : "zero";
  if (c.found.terms.size() > most_terms) return fmt::format("a combination of {} samples", c.found.terms.size());
  if (c.same) return fmt::format("{} is {}", c.text, what);
  std::vector<std::string> names;
  for (const auto& [name, factor] : c.found.terms) names.push_back(name);
  return fmt::format("a combination of {} that changes from step to step is {}", listed(names), what);
}

// Are the samples of this column those of the other one, as far as a few of them tell?
bool looks_equal(const Matrix& samples, Index a, Index b) {
  for (Index n = 0; n < std::min<Index>(3, samples.rows()); ++n)
    if (const double x = samples(n, a), y = samples(n, b); x != y && !(std::isnan(x) || std::isnan(y))) return false;
  return true;
}

// An output that stays where it is in one experiment, far longer than in any other.
std::string standstill(const Ensemble& e, Index j, Index origin) {
  const Index d = e.channels(), c = e.inputs() + j, count = e.experiments();
  std::vector<Index> run(size_t(count), 0), longest(size_t(count), 0), end(size_t(count), 0);
  for (Index k = 1; k < e.steps(); ++k) {
    const auto before = e.samples().col((k - 1) * d + c), now = e.samples().col(k * d + c);
    for (Index n = 0; n < count; ++n) {
      Index& own = run[size_t(n)];
      own = now(n) == before(n) ? own + 1 : 0;
      if (own > longest[size_t(n)]) longest[size_t(n)] = own, end[size_t(n)] = k;
    }
  }
  const size_t at = size_t(std::max_element(longest.begin(), longest.end()) - longest.begin());
  const Index steps = longest[at] + 1;
  longest[at] = 0;
  const Index others = *std::max_element(longest.begin(), longest.end()) + 1;
  if (steps < std::max<Index>(8, e.steps() / 10) || steps < 3 * others) return "";
  return fmt::format(
      "output {} stays at {:.3g} in experiment {} at steps {}–{}, which it does nowhere else: is its sensor stuck there?",
      e.names.output(j), e.y(Index(at), end[at], j), at, origin + end[at] - steps + 1, origin + end[at]);
}

}  // namespace

Excitation excitation(const Ensemble& e, const ExcitationOptions& o) {
  const Inspection inspect(e, o);
  const Index steps = e.steps(), r = e.inputs();
  std::vector<std::vector<Index>> groups;
  if (o.period > 0 && o.period < steps) {
    const Index phases = std::min<Index>(o.period, 8);
    for (Index i = 0; i < phases; ++i) {
      std::vector<Index> group;
      for (Index k = i * o.period / phases; k < steps; k += o.period)
        if (k >= o.lags) group.push_back(k);
      if (!group.empty()) groups.push_back(std::move(group));
    }
  } else {
    for (Index k = 0; k < steps; ++k) groups.push_back({k});
  }
  const bool each = o.period == 0;

  Cases together, before;
  if (r > 1)
    for (const auto& group : groups)
      if (o.period > 0 || inspect.may_be(group.front()))
        for (auto& found : inspect.of(group, false)) together.add(std::move(found), group.front());

  // Of the samples before: where a few values say so, at the suspects, and at some steps; then at all.
  std::vector<Index> few = each ? spread(1, steps, sampled_steps) : spread(0, Index(groups.size()), sampled_steps);
  if (each) {
    few.insert(few.end(), o.suspects.begin(), o.suspects.end());
    for (Index k = 1; k < steps; ++k)
      for (Index i = 0; i < r; ++i)
        if (looks_equal(e.samples(), k * e.channels() + i, (k - 1) * e.channels() + i)) few.push_back(k);
    std::sort(few.begin(), few.end());
    few.erase(std::unique(few.begin(), few.end()), few.end());
  }
  bool any = false;
  for (const Index g : few)
    if (any = any || !inspect.of(groups[size_t(g)], true).empty(); any) break;
  if (any)
    for (const auto& group : groups)
      if (group.front() > 0)
        for (auto& found : inspect.of(group, true)) before.add(std::move(found), group.front());

  Excitation result;
  const auto where = [&](const Case& c) {
    if (o.period == 1) return std::string("all along");
    std::vector<Index> shown = c.steps;
    for (Index& k : shown) k += o.origin;
    result.named.insert(result.named.end(), c.steps.begin(), c.steps.end());
    return fmt::format("{} {}", each ? "in every experiment at" : "at the phases of", words::step_list(shown));
  };
  for (const Case& c : together.most())
    result.warnings.push_back(fmt::format("inputs {} move together ({}) {}: their effects there can't be told apart",
                                          listed(c.found.channels), combination_text(c), where(c)));
  for (const Case& c : before.most()) {
    const std::string name = c.found.channels.front();
    result.warnings.push_back(
        c.found.feedback
            ? fmt::format("input {} follows from the samples before it ({}) {}: a feedback without a variation of its "
                          "own, whose effect there can't be told from theirs",
                          name, combination_text(c), where(c))
            : fmt::format("input {} follows from inputs before it ({}) {}: its effect there can't be told from theirs",
                          name, combination_text(c), where(c)));
  }
  std::sort(result.named.begin(), result.named.end());
  result.named.erase(std::unique(result.named.begin(), result.named.end()), result.named.end());
  return result;
}

std::vector<std::string> warnings_of_dependent_outputs(const Ensemble& e, Index origin) {
  const Index m = e.outputs(), r = e.inputs(), d = e.channels();
  std::vector<std::string> result;
  // Pairs and more of them, where one combination holds at all steps at which the output moves.
  std::vector<Index> others{0};
  const bool single = e.experiments() < 8;
  for (Index j = 1; j < m; ++j) {
    std::optional<std::string> text;
    std::vector<std::string> names;
    Index held = 0;
    bool always = true, constant = false;
    for (const Index k : spread(0, e.steps(), single ? 1 : sampled_outputs)) {
      Matrix y;
      if (single) {  // one record, or a few: all of their samples
        y.resize(std::min(most_rows, e.experiments() * e.steps()), m);
        Index used = 0;
        for (Index i = 0; i < y.rows(); ++i) {
          const Index at = i * (e.experiments() * e.steps() / y.rows());
          const auto row = e.output(at / e.experiments()).row(at % e.experiments());
          if (!row.array().isNaN().any()) y.row(used++) = row;
        }
        y.conservativeResize(used, m);
      } else {
        y = e.output(k)(e.complete_rows(k, 0), Eigen::all);
      }
      if (y.rows() == 0 || (y.col(j).array() == y(0, j)).all()) continue;
      const auto c = combination(y(Eigen::all, others), y.col(j), true);
      always = c.has_value() && c->terms.size() < most_terms;
      if (!always) break;
      std::vector<std::pair<std::string, double>> terms;
      names.clear();
      for (const Combination::Term& t : c->terms) {
        names.push_back(e.names.output(others[size_t(t.column)]));
        terms.emplace_back(names.back(), -t.factor);
      }
      names.push_back(e.names.output(j));
      terms.emplace_back(names.back(), 1.0);
      constant = constant || c->constant;
      const std::string own = sum_text(terms);
      always = !text || *text == own;
      if (!always) break;
      text = own;
      ++held;
    }
    if (always && (single ? held > 0 : held > 2))
      result.push_back(
          fmt::format("outputs {} move together ({} is {}) at all steps: {} says nothing that the others "
                      "don't",
                      listed(names), *text, constant ? "constant" : "zero", names.back()));
    else
      others.push_back(j);
  }
  if (e.experiments() < 2) return result;
  for (Index j = 0; j < m; ++j) {
    if (std::string text = standstill(e, j, origin); !text.empty()) result.push_back(std::move(text));
    std::vector<Index> still;
    bool moved = false;
    for (Index k = 0; k < e.steps(); ++k) {
      const auto y = e.samples().col(k * d + r + j);
      bool same = true;
      double value = std::numeric_limits<double>::quiet_NaN();
      Index present = 0;
      for (Index n = 0; n < y.size() && same; ++n) {
        if (std::isnan(y(n))) continue;
        ++present;
        if (std::isnan(value)) value = y(n);
        same = y(n) == value;
      }
      if (!same)
        moved = true;
      else if (moved && present > 1)
        still.push_back(origin + k);
    }
    if (moved && !still.empty())
      result.push_back(
          fmt::format("output {} is the same in every experiment at {}: nothing can be identified of it there",
                      e.names.output(j), words::step_list(still)));
  }
  return result;
}

}  // namespace tokid
