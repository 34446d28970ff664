// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/excitation.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "data/subjects.hpp"
#include "diagnose/combination.hpp"
#include "diagnose/standstill.hpp"

namespace tokid {

namespace {

// Combinations of at most this many terms are the same if all terms are the same, longer ones if their first terms are
// the same.
constexpr size_t most_terms = 4;
// Most columns that are searched for a combination: the time grows with their cube.
constexpr Index most_columns = 40;
// An output has no significant noise if the inputs and earlier samples explain all of it except this share.
constexpr double answers = 100 * nothing_left;
// Number of steps that represent all steps for inputs, and for outputs.
constexpr Index sampled_steps = 24, sampled_outputs = 16;
// Most different combinations that are reported.
constexpr size_t most_cases = 4;
// A finding is reported if chance produces it with at most this probability.
constexpr double chance_of_alarm = 1e-4;
// For coupled steps, a dependence is reported only if it holds at this many successive steps, or at this share of all
// steps.
constexpr Index long_run = 8;
constexpr double large_share = 0.2;
// Number of samples of a channel among which equal values are counted.
constexpr Index sampled_values = 2000;
// Most rows of a pooled record that are used: a relation that holds in so many rows holds in all.
constexpr Index most_rows = 2000;

// Steps spread over a range at irregular distances. Regular distances could miss the changes of inputs that are held or
// that repeat.
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

// Number of occurrences of the most frequent value.
Index most_alike(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  size_t most = 0;
  for (size_t i = 0, begin = 0; i < values.size(); ++i) {
    if (values[i] != values[begin]) begin = i;
    most = std::max(most, i - begin + 1);
  }
  return Index(most);
}

// `value`: share of the most frequent value of channel c, over steps at which the channel differs between experiments.
// `held`: share of the values that equal the value of the step before.
struct Coincidence {
  double value = 0.0, held = 0.0;
};

Coincidence coincidence(const Ensemble& e, Index c) {
  const Index d = e.channels(), each = std::min<Index>(e.experiments(), 100);
  std::vector<double> values;
  Index held = 0, pairs = 0;
  for (const Index k : spread(0, e.steps(), sampled_values / each)) {
    const auto now = e.samples().col(k * d + c);
    bool varies = false;
    for (Index n = 1; n < now.size() && !varies; ++n) varies = now(n) != now(0);
    for (Index i = 0; i < each && (varies || now.size() == 1); ++i)
      if (const double value = now(i * e.experiments() / each); !std::isnan(value)) values.push_back(value);
    for (Index i = 0; i < each && k > 0; ++i) {
      const Index n = i * e.experiments() / each;
      held += now(n) == e.samples()(n, (k - 1) * d + c);
      ++pairs;
    }
  }
  const Index all = Index(values.size());
  return {all > 1 ? double(most_alike(std::move(values)) - 1) / double(all - 1) : 0.0,
          pairs > 0 ? double(held) / double(pairs) : 0.0};
}

double log_binomial(Index n, Index k) {
  return std::lgamma(double(n) + 1) - std::lgamma(double(k) + 1) - std::lgamma(double(n - k) + 1);
}

// Upper bound of the log-probability that at least `steps` of `all` steps occur by chance, each with this probability.
double log_chance(Index all, Index steps, double log_each) {
  return log_binomial(all, steps) + double(steps) * log_each;
}

// Inspects the samples of steps that share a model, and the samples before them.
class Inspection {
 public:
  Inspection(const Ensemble& e, const ExcitationOptions& o) : e_(e), o_(o) {
    for (Index i = 0; i < e.inputs(); ++i) coincidence_.push_back(coincidence(e, i));
  }

  struct Found {
    std::vector<Finding::Term> terms;  // the channel itself is first, or last in a combination without earlier samples
    bool feedback = false, constant = false;
    // Logarithms of the probability of a fit by chance at one step, and of the number of possible combinations.
    double log_chance = 0.0, log_choices = 0.0;
    Index depth() const {
      Index most = 0;
      for (const Finding::Term& term : terms) most = std::max(most, term.lag);
      return most;
    }
  };

  // May the inputs of step k be dependent? False if a few experiments already rule this out.
  bool may_be(Index k) const {
    const Index r = e_.inputs(), needed = r + 5, count = e_.experiments();
    few_.clear();
    Index rows = 0;
    for (Index i = 0; i < 3 * needed && rows < needed; ++i) {
      const auto u = e_.input(k).row((i * count / (3 * needed) + i) % count);
      if (u.array().isNaN().any()) continue;
      few_.insert(few_.end(), u.begin(), u.end());
      ++rows;
    }
    if (rows < needed) return true;
    // Gram-Schmidt orthogonalisation of the columns about their means.
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

  // Finds inputs of the steps that are combinations of each other or, if `with_past`, of earlier samples.
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
    // combination() takes the first of equally good columns, so the newest samples come first.
    for (Index j = 1; j <= lags; ++j)
      for (Index c = 0; c < d; ++c) others.push_back((lags - j) * d + c);
    if (o_.noisy && lags > 0)
      for (Index c = r; c < d; ++c) {
        // An output that follows from the inputs and earlier samples is a response to the inputs, not their cause.
        if (unexplained(rows.leftCols(lags * d + r), rows.col(lags * d + c), o_.centred) <= answers) continue;
        others.push_back(lags * d + c);
      }
    for (Index i = 0; i < r; ++i) {
      const auto own = rows.col(lags * d + i);
      std::optional<Combination> c = combination(rows(Eigen::all, others), own, o_.centred);
      // If one model serves all steps, the shortest recursion is taken, because its order shows the number of sines in
      // the input.
      if (c && with_past && o_.period == 1)
        for (Index q = 1; q < lags; ++q)
          if (auto shorter = combination(rows(Eigen::all, std::vector<Index>(others.begin(), others.begin() + q * d)),
                                         own, o_.centred)) {
            c = std::move(shorter);
            break;
          }
      if (c) {
        Found f;
        f.constant = c->constant;
        const Coincidence& often = coincidence_[size_t(i)];
        const double each = std::max({nothing_left, often.value, with_past ? often.held : 0.0});
        const Index terms = Index(c->terms.size());
        f.log_chance = double(std::max<Index>(0, rows.rows() - terms - (o_.centred ? 1 : 0))) * std::log(each);
        f.log_choices = log_binomial(Index(others.size()), terms);
        f.terms.push_back({channel(i), 0, 1.0});
        for (const Combination::Term& t : c->terms) {
          const Index at = others[size_t(t.column)] % d;
          f.feedback = f.feedback || at >= r;
          f.terms.push_back({channel(at), lags - others[size_t(t.column)] / d, -t.factor});
        }
        if (!with_past)
          std::rotate(f.terms.begin(), f.terms.begin() + 1, f.terms.end());  // in the order of the
                                                                             // channels
        found.push_back(std::move(f));
      } else if (!with_past) {
        others.push_back(i);
      }
    }
    return found;
  }

  // A sum of s sines satisfies a recursion of order 2s with symmetric coefficients. Returns s, or 0 if the combination
  // is not such a recursion.
  Index sines(const Found& f) const {
    const Finding::Channel& own = f.terms.front().channel;
    const Index order = f.depth();
    if (o_.period != 1 || e_.inputs() != 1 || order < 2 || order % 2 != 0) return 0;
    for (const Finding::Term& term : f.terms)
      if (term.channel != own || (term.lag == order && std::abs(term.factor - 1) > 1e-3)) return 0;
    return order / 2;
  }

  Finding::Channel channel(Index c) const { return tokid::channel(e_.names, e_.inputs(), c); }

 private:
  // [v_{k-q} … v_k] of experiments that have these samples. At most `most` are taken, spread over steps and
  // experiments.
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
  std::vector<Coincidence> coincidence_;  // (r)
  mutable std::vector<double> few_;
};

// The steps at which one combination holds, whatever its factors are.
struct Case {
  Inspection::Found found;
  bool same = true;  // same factors at all steps
  std::vector<Index> steps;
  Index independent = 0;  // steps without those whose inputs repeat the step before
};

class Cases {
 public:
  void add(Inspection::Found found, Index step, bool repeats) {
    Case& c = cases_[key_of(found)];
    if (c.steps.empty()) {
      c.found = std::move(found);
    } else {
      c.same = c.same && same_sum(found.terms, c.found.terms);
      c.found.constant = c.found.constant || found.constant;
      c.found.log_chance = std::max(c.found.log_chance, found.log_chance);
      c.found.log_choices = std::max(c.found.log_choices, found.log_choices);
    }
    if (!c.steps.empty() && c.steps.back() == step) return;
    c.independent += c.steps.empty() || c.steps.back() + 1 != step || !repeats;
    c.steps.push_back(step);
  }

  // Cases with the most steps first, without cases that chance produces at so many steps.
  std::vector<Case> most(Index all, bool shared) const {
    std::vector<Case> list;
    for (const auto& [key, c] : cases_)
      if (c.found.log_choices + log_chance(all, c.independent, c.found.log_chance) <= std::log(chance_of_alarm) &&
          (!shared || weighty(c, all)))
        list.push_back(c);
    std::stable_sort(list.begin(), list.end(),
                     [](const Case& a, const Case& b) { return a.steps.size() > b.steps.size(); });
    return list;
  }

 private:
  static bool weighty(const Case& c, Index all) {
    Index run = 1, longest = 1;
    for (size_t i = 1; i < c.steps.size(); ++i) {
      run = c.steps[i] == c.steps[i - 1] + 1 ? run + 1 : 1;
      longest = std::max(longest, run);
    }
    return longest >= std::min(long_run, all) || double(c.steps.size()) >= large_share * double(all);
  }

  // The samples of all terms if the terms are few, otherwise the sample of the first term.
  using Key = std::pair<bool, std::vector<std::tuple<bool, Index, Index>>>;
  static Key key_of(const Inspection::Found& found) {
    Key key{found.terms.size() > most_terms, {}};
    for (const Finding::Term& term : found.terms) {
      key.second.emplace_back(term.channel.output, term.channel.index, term.lag);
      if (key.first) break;
    }
    return key;
  }

  std::map<Key, Case> cases_;
};

// Do a few samples suggest that these two columns are equal?
bool looks_equal(const Matrix& samples, Index a, Index b) {
  for (Index n = 0; n < std::min<Index>(3, samples.rows()); ++n)
    if (const double x = samples(n, a), y = samples(n, b); x != y && !(std::isnan(x) || std::isnan(y))) return false;
  return true;
}

// Steps at which an output is the same in every experiment, after it has first varied. Empty if this may be chance.
std::vector<Index> constant_steps(const Ensemble& e, Index j) {
  const Index d = e.channels(), c = e.inputs() + j;
  std::vector<Index> still;
  Index fewest = e.experiments();
  double alike = 0.0;  // share of the most frequent value at neighbouring steps
  const auto look_beside = [&](Index k) {
    std::vector<double> values;
    for (const double value : e.samples().col(k * d + c))
      if (!std::isnan(value)) values.push_back(value);
    const Index all = Index(values.size()), most = most_alike(std::move(values));
    if (most > 1 && most < all) alike = std::max(alike, double(most) / double(all));
  };
  bool moved = false;
  for (Index k = 0, before = -2; k < e.steps(); ++k) {
    const auto y = e.samples().col(k * d + c);
    double value = nan;
    Index present = 0;
    bool same = true;
    for (Index n = 0; n < y.size() && same; ++n) {
      if (std::isnan(y(n))) continue;
      ++present;
      if (std::isnan(value)) value = y(n);
      same = y(n) == value;
    }
    const bool constant = same && moved && present > 1;
    if (constant) {
      still.push_back(k);
      fewest = std::min(fewest, present);
    }
    if (!same && moved && before == k - 1) look_beside(k);
    if (constant && before != k - 1) look_beside(k - 1);
    if (constant) before = k;
    moved = moved || !same;
  }
  if (still.empty()) return {};
  const double each = std::max({nothing_left, coincidence(e, c).value, alike});
  const bool chance =
      log_chance(e.steps(), Index(still.size()), double(fewest - 1) * std::log(each)) > std::log(chance_of_alarm);
  return chance ? std::vector<Index>{} : still;
}

std::vector<Finding::Channel> channels_of(const std::vector<Finding::Term>& terms) {
  std::vector<Finding::Channel> channels;
  for (const Finding::Term& term : terms) channels.push_back(term.channel);
  return channels;
}

// Two or more outputs for which one combination holds at all steps at which the last of them varies.
Findings moving_together(const Ensemble& e) {
  const Index m = e.outputs();
  Findings result;
  std::vector<Index> others{0};
  const bool single = e.experiments() < 8;
  for (Index j = 1; j < m; ++j) {
    std::vector<Finding::Term> reported;
    Index held = 0;
    bool always = true, constant = false;
    for (const Index k : spread(0, e.steps(), single ? 1 : sampled_outputs)) {
      Matrix y;
      if (single) {  // few experiments: all of their samples together
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
      std::vector<Finding::Term> terms;
      for (const Combination::Term& t : c->terms)
        terms.push_back({output_channel(e.names, others[size_t(t.column)]), 0, -t.factor});
      terms.push_back({output_channel(e.names, j), 0, 1.0});
      constant = constant || c->constant;
      always = reported.empty() || same_sum(terms, reported);
      if (!always) break;
      if (reported.empty()) reported = std::move(terms);
      ++held;
    }
    if (always && (single ? held > 0 : held > 2))
      result.push_back({.kind = Finding::Kind::outputs_dependent,
                        .channels = channels_of(reported),
                        .numbers = {{"constant", constant}},
                        .terms = reported});
    else
      others.push_back(j);
  }
  return result;
}

// The steps that share their effects: each step alone, or some phases of a period.
class Groups {
 public:
  Groups(Index steps, const ExcitationOptions& o) : steps_(steps), distance_(steps) {
    if (o.period > 0 && o.period < steps) {
      distance_ = o.period;
      const Index phases = std::min<Index>(o.period, 8);
      for (Index i = 0; i < phases; ++i) {
        Index first = i * o.period / phases;
        if (first < o.lags) first += ceil_div(o.lags - first, o.period) * o.period;
        if (first < steps) first_.push_back(first);
      }
    } else {
      first_ = o.sampled ? spread(1, steps, sampled_steps) : range(0, steps);
    }
  }

  Index size() const { return Index(first_.size()); }
  Index first(Index group) const { return first_[size_t(group)]; }
  std::vector<Index> operator[](Index group) const {
    std::vector<Index> result;
    for (Index k = first(group); k < steps_; k += distance_) result.push_back(k);
    return result;
  }

 private:
  Index steps_, distance_;
  std::vector<Index> first_;
};

// Inputs of one step that depend on each other.
Cases dependent_together(const Ensemble& e, const Inspection& inspect, const Groups& groups,
                         const ExcitationOptions& o) {
  const bool each = o.period == 0;
  const auto repeats = [&](Index k) {
    for (Index i = 0; each && k > 0 && i < e.inputs(); ++i)
      if (e.input(k).col(i) != e.input(k - 1).col(i)) return false;
    return each && k > 0;
  };
  Cases cases;
  if (e.inputs() < 2) return cases;
  for (Index g = 0; g < groups.size(); ++g)
    if (const Index k = groups.first(g); o.period > 0 || inspect.may_be(k))
      for (auto& found : inspect.of(groups[g], false)) cases.add(std::move(found), k, repeats(k));
  return cases;
}

// Inputs that depend on earlier samples. The check begins at `dependent_steps`, at steps where a few values suggest a
// dependence, and at some other steps. If one of these steps is dependent, all steps are checked.
Cases dependent_on_past(const Ensemble& e, const Inspection& inspect, const Groups& groups,
                        const ExcitationOptions& o) {
  const Index steps = e.steps();
  std::vector<Index> few;
  if (o.period == 0 && !o.sampled) {
    few = spread(1, steps, sampled_steps);
    few.insert(few.end(), o.dependent_steps.begin(), o.dependent_steps.end());
    for (Index k = 1; k < steps; ++k)
      for (Index i = 0; i < e.inputs(); ++i)
        if (looks_equal(e.samples(), k * e.channels() + i, (k - 1) * e.channels() + i)) few.push_back(k);
    std::sort(few.begin(), few.end());
    few.erase(std::unique(few.begin(), few.end()), few.end());
  } else {
    few = spread(0, groups.size(), sampled_steps);
  }
  Cases cases;
  if (std::none_of(few.begin(), few.end(), [&](Index g) { return !inspect.of(groups[g], true).empty(); })) return cases;
  for (Index g = 0; g < groups.size(); ++g)
    if (groups.first(g) > 0)
      for (auto& found : inspect.of(groups[g], true)) cases.add(std::move(found), groups.first(g), false);
  return cases;
}

// Adds the findings of these cases, and the steps whose windows contain them.
void report(const std::vector<Case>& cases, bool with_past, const Ensemble& e, const Inspection& inspect,
            const ExcitationOptions& o, Excitation& result) {
  for (size_t i = 0; i < std::min(most_cases, cases.size()); ++i) {
    const Case& c = cases[i];
    // The windows of later steps contain this dependence too.
    for (const Index k : c.steps)
      for (Index later = k; later < std::min(e.steps(), k + std::max<Index>(1, o.lags - c.found.depth() + 1)); ++later)
        result.named.push_back(later);
    Finding finding{.kind = !with_past         ? Finding::Kind::inputs_dependent
                            : c.found.feedback ? Finding::Kind::input_feedback
                                               : Finding::Kind::input_predictable,
                    .channels = with_past ? std::vector{c.found.terms.front().channel} : channels_of(c.found.terms),
                    .steps = c.steps,
                    .numbers = {{"constant", c.found.constant}, {"varying", !c.same}, {"period", double(o.period)}},
                    .terms = c.found.terms};
    if (o.period == 1) finding.steps.clear();  // all of them
    if (const Index sines = with_past ? inspect.sines(c.found) : 0; sines > 0) {
      finding.numbers["sines"] = double(sines);
      finding.numbers["sines_needed"] = double((2 + o.lags * e.channels()) / 2);
      finding.numbers["lags"] = double(o.lags);
    }
    result.findings.push_back(std::move(finding));
  }
  if (cases.size() > most_cases)
    result.findings.push_back(
        {.kind = Finding::Kind::more_dependent_inputs, .numbers = {{"count", double(cases.size() - most_cases)}}});
}

}  // namespace

Excitation excitation(const Ensemble& e, const ExcitationOptions& o) {
  const Inspection inspect(e, o);
  const Groups groups(e.steps(), o);
  const Index all = groups.size();
  const std::vector<Case> together = dependent_together(e, inspect, groups, o).most(all, o.shared);
  const std::vector<Case> on_past = dependent_on_past(e, inspect, groups, o).most(all, o.shared);
  Excitation result;
  result.places = all;
  report(together, false, e, inspect, o, result);
  report(on_past, true, e, inspect, o, result);
  std::sort(result.named.begin(), result.named.end());
  result.named.erase(std::unique(result.named.begin(), result.named.end()), result.named.end());
  return result;
}

Findings findings_of_dependent_outputs(const Ensemble& e) {
  Findings result = moving_together(e);
  if (e.experiments() < 2) return result;
  for (Index j = 0; j < e.outputs(); ++j) {
    std::vector<Index> still = constant_steps(e, j);
    if (!still.empty())
      result.push_back(
          {.kind = Finding::Kind::output_same, .channels = {output_channel(e.names, j)}, .steps = std::move(still)});
  }
  return result;
}

StuckOutputs stuck_outputs(const Ensemble& e) {
  StuckOutputs result;
  for (Index j = 0; j < e.outputs(); ++j) {
    const std::vector<Standstill> stuck = standstills(e, e.inputs() + j);
    for (const Standstill& s : stuck) result.experiments.push_back(s.experiment);
    for (size_t i = 0; i < std::min(most_cases, stuck.size()); ++i) {
      result.findings.push_back({.kind = Finding::Kind::output_stuck,
                                 .channels = {output_channel(e.names, j)},
                                 .experiments = {experiment(e, stuck[i].experiment)},
                                 .steps = range(stuck[i].begin, stuck[i].end),
                                 .numbers = {{"value", stuck[i].value}}});
    }
    if (stuck.size() > most_cases)
      result.findings.push_back({.kind = Finding::Kind::more_stuck_outputs,
                                 .channels = {output_channel(e.names, j)},
                                 .numbers = {{"count", double(stuck.size() - most_cases)}}});
  }
  return result;
}

}  // namespace tokid
