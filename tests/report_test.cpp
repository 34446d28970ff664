// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/report.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "report/evidence.hpp"
#include "report/model_comparison.hpp"
#include "report/origin.hpp"
#include "report/page.hpp"
#include "report/report_data.hpp"
#include "report/responses.hpp"
#include "report/validated.hpp"
#include "report/verdict_json.hpp"
#include "testing.hpp"
#include "tokid/copies.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"
#include "tokid/remarks.hpp"

namespace tokid::testing {
namespace {

using report::escape;

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

std::string all_reasons(const Verdict& verdict) {
  std::string text;
  for (const std::string& reason : verdict.reasons) text += reason + "\n";
  return text;
}

// Page

TEST(Escape, LeavesNothingThatHtmlReadsAsMoreThanText) {
  EXPECT_EQ(escape("<img src=\"x\" onerror='f()'> & co"),
            "&lt;img src=&quot;x&quot; onerror=&#39;f()&#39;&gt; &amp; co");
  EXPECT_EQ(escape("Δp [N·m] 🛩"), "Δp [N·m] 🛩");
  EXPECT_EQ(escape(""), "");
}

TEST(Escape, ReplacesWhatIsNoText) {
  const std::string bad = "\xEF\xBF\xBD";
  EXPECT_EQ(escape("a\nb\tc\x7F"), "a b c ");
  EXPECT_EQ(escape(std::string_view("a\0b", 3)), "a b");
  EXPECT_EQ(escape("\xC2\x85"), " ");                            // a control character of two bytes
  EXPECT_EQ(escape("\xFF"), bad);                                // never in UTF-8
  EXPECT_EQ(escape("x\xE2\x82"), "x" + bad + bad);               // cut off
  EXPECT_EQ(escape("\xC0\xBC"), bad + bad);                      // an overlong '<'
  EXPECT_EQ(escape("\xED\xA0\x80"), bad + bad + bad);            // a surrogate
  EXPECT_EQ(escape("\xF4\x90\x80\x80"), bad + bad + bad + bad);  // beyond the last code point
}

TEST(ScriptJson, StaysWithinItsElementAndMeansTheSame) {
  const std::string nasty = "</script><!-- <script> --> & \xE2\x80\xA8 \xE2\x80\xA9 ]]>";
  const std::string html = report::script_json("x", nlohmann::json{{nasty, nasty}}.dump());
  const size_t begin = html.find('>') + 1, end = html.rfind("</script>");
  const std::string inner = html.substr(begin, end - begin);
  for (const char* part : {"<", ">", "&", "\xE2\x80\xA8", "\xE2\x80\xA9"}) EXPECT_FALSE(contains(inner, part)) << part;
  EXPECT_EQ(nlohmann::json::parse(inner).at(nasty), nasty);
}

TEST(Script, RefusesCodeThatWouldEndIt) {
  EXPECT_THROW(report::script("'</script>'"), std::invalid_argument);
  EXPECT_TRUE(contains(report::script("f()"), "f()"));
}

TEST(Table, EscapesItsCellsAndNeedsAllOfThem) {
  report::Table table({{"<b>", report::Table::Align::text}, {"n"}}, "<caption>");
  table.row({"<i>", "1"});
  EXPECT_THROW(table.row({"alone"}), std::invalid_argument);
  const std::string html = table.html();
  EXPECT_TRUE(contains(html, "&lt;b&gt;") && contains(html, "&lt;i&gt;") && contains(html, "&lt;caption&gt;"));
  EXPECT_FALSE(contains(html, "<b>") || contains(html, "<i>"));
}

// Words

TEST(Words, PercentagesAreCutAndNeverRoundedUpToPerfection) {
  EXPECT_EQ(words::percent(93.99), "93.9 %");
  EXPECT_EQ(words::percent(99.97), "99.97 %");
  EXPECT_EQ(words::percent(99.99999), "99.99999 %");
  EXPECT_EQ(words::percent(100 - 1e-9), "100 %");
  EXPECT_EQ(words::percent(84.26, 1), "84.2 %");
  EXPECT_EQ(words::percent(-7.5), "−8 %");
  EXPECT_EQ(words::percent(-1e12), "below −999 %");
  EXPECT_EQ(words::percent(nan), "–");
  EXPECT_EQ(words::percent_range(Vector{{83.9, nan, 97.19}}), "83–97.1 %");
  EXPECT_EQ(words::percent_range(Vector{{-3.0, 50.0}}), "−3 to 50 %");
  EXPECT_EQ(words::percent_range(Vector{{nan}}), "–");
}

TEST(Words, StepsAreJoinedToAFewRanges) {
  EXPECT_EQ(words::step_list({41, 42, 43, 44}), "steps 41–44");
  EXPECT_EQ(words::step_list({7}), "step 7");
  EXPECT_EQ(words::step_list({1, 2, 5}), "steps 1–2 and 5");
  EXPECT_EQ(words::step_list({1, 3, 5, 7, 9, 11, 13}), "steps 1, 3, 5, 7, 9, 11 and more (7 in all)");
}

// Thinning

TEST(Grid, KeepsEveryPeakAndEveryGap) {
  Random random(1);
  for (const Index steps : {1, 2, 7, 100, 101, 1000, 4001})
    for (const Index points : {2, 10, 64}) {
      std::vector<double> values;
      for (Index k = 0; k < steps; ++k) values.push_back(random.normal());
      const report::Grid grid = report::make_grid(3, steps, points);
      const std::vector<double> thin = grid.thin(values);
      ASSERT_EQ(thin.size(), grid.x.size());
      EXPECT_LE(Index(thin.size()), std::max<Index>(points, 2) + 1);
      EXPECT_TRUE(std::is_sorted(grid.x.begin(), grid.x.end(), std::less_equal<>()));
      EXPECT_EQ(grid.x.front(), 3);
      EXPECT_EQ(*std::max_element(thin.begin(), thin.end()), *std::max_element(values.begin(), values.end()));
      EXPECT_EQ(*std::min_element(thin.begin(), thin.end()), *std::min_element(values.begin(), values.end()));
      if (steps <= points) {
        EXPECT_EQ(thin, values);
      }
    }
  // A stretch without a value stays a gap, one with some is drawn by them.
  const report::Grid grid = report::make_grid(0, 8, 4);
  ASSERT_EQ(grid.stretch, 4);
  const std::vector<double> thin = grid.thin({nan, nan, nan, nan, nan, 2, nan, 1});
  EXPECT_TRUE(std::isnan(thin[0]) && std::isnan(thin[1]));
  EXPECT_EQ(thin[2], 2);  // in the order in which they come
  EXPECT_EQ(thin[3], 1);
}

TEST(Shown, HasTheBestTheMedianAndTheWorst) {
  report::Evidence found;
  found.fits.excess.resize(100);
  for (Index n = 0; n < 100; ++n) found.fits.excess(n) = n == 17 ? 90.0 : n == 71 ? 0.5 : 1 + 0.01 * double(n);
  found.fits.excess(5) = nan;
  for (Index n = 0; n < 100; ++n) found.fits.worst_first.push_back(n);
  std::stable_sort(found.fits.worst_first.begin(), found.fits.worst_first.end(), [&](Index a, Index b) {
    return !(found.fits.excess(a) <= found.fits.excess(b)) && a != 5;  // the one without an error comes last
  });
  for (Index n = 0; n < 100; ++n) found.rows.push_back(3 * n);
  found.experiment_names.assign(100, "");
  found.experiment_names[17] = "wild";
  for (const Index most : {3, 10, 100, 500}) {
    const report::Shown shown = report::shown_experiments(found, most);
    EXPECT_EQ(Index(shown.rows.size()), std::min<Index>(100, most));
    EXPECT_TRUE(std::is_sorted(shown.rows.begin(), shown.rows.end()));
    for (const Index n : {17, 71}) EXPECT_TRUE(std::binary_search(shown.rows.begin(), shown.rows.end(), n)) << n;
    EXPECT_TRUE(contains(shown.labels[shown.first], "median"));
    const auto label = [&](Index n) {
      return shown.labels[size_t(std::find(shown.rows.begin(), shown.rows.end(), n) - shown.rows.begin())];
    };
    EXPECT_EQ(label(17), "Experiment \"wild\" (row 51) (largest error)");
    EXPECT_EQ(label(71), "Experiment 213 (smallest error)");
  }
  EXPECT_EQ(report::shown_experiments(found, 1).rows.size(), 1u);
}

// Verdicts

struct Case {
  Model model;
  Ensemble data;
};

Ensemble noisy(Index experiments, std::uint64_t seed, Index steps = 40) {
  ExperimentOptions options;
  options.experiments = experiments;
  options.measurement_noise = 0.02;
  options.seed = seed;
  return tokid::experiments(oscillator(steps), options);
}

TEST(Verdict, TrustsAModelThatPredictsFreshData) {
  // Without observer gains the innovations are the measurement noise itself, which is white.
  Model model = oscillator(40);
  for (Step& step : model.step) step.G().setZero();
  const Verdict v = verdict(model, noisy(20, 2));
  EXPECT_EQ(v.trust, Trust::good) << all_reasons(v);
  EXPECT_TRUE(v.reasons.empty());
  EXPECT_TRUE(contains(v.summary, "on 20 experiments given")) << v.summary;
}

TEST(Verdict, KnowsTheDataOfTheIdentificationByAnyMethod) {
  const Ensemble data = noisy(60, 3);
  for (const bool refine : {false, true}) {
    const Model model = identify(data, {.states = 4, .lags = 4, .refine = refine}).model;
    EXPECT_TRUE(has_seen(model.provenance, data));
  }
}

TEST(Verdict, KnowsTheDataOfTheIdentification) {
  const Ensemble data = noisy(60, 3), fresh = noisy(60, 4);
  IdentifyOptions options;
  options.states = 4;
  options.method = Method::tvera;
  for (const double hold_out : {0.0, 0.25}) {
    options.hold_out = hold_out;
    const Model model = identify(data, options).model;
    const report::Tested tested = report::tested(model, data, {});
    EXPECT_EQ(tested.options.evaluation, hold_out > 0 ? Evaluation::held_out : Evaluation::training);
    EXPECT_EQ(tested.data.experiments(), hold_out > 0 ? 15 : 60);
    EXPECT_EQ(report::tested(model, fresh, {}).options.evaluation, Evaluation::given);
    EXPECT_EQ(report::tested(model, noisy(60, 3, 30), {}).options.evaluation, Evaluation::given);
    EXPECT_TRUE(contains(verdict(model, data).summary, hold_out > 0 ? "15 held-out" : "identified from"));
  }
  // Without noise, and with a mean motion.
  ExperimentOptions exact;
  exact.experiments = 20;
  Ensemble clean = experiments(oscillator(40), exact);
  exact.seed = 9;
  const Ensemble other = experiments(oscillator(40), exact);
  const Model model = identify(clean).model;
  EXPECT_TRUE(has_seen(model.provenance, clean));
  EXPECT_FALSE(has_seen(model.provenance, other));
  for (Index k = 0; k < clean.steps(); ++k) clean.input(k).array() += 3.0;
  clean = simulate(oscillator(40), clean);
  const Model moved = identify(clean, {.nominal = NominalChoice::mean}).model;
  EXPECT_TRUE(has_seen(moved.provenance, clean));
}

TEST(Verdict, DoesNotTrustFewTrainingExperiments) {
  ExperimentOptions options;
  options.experiments = 10;  // as many as unknowns at p = 2
  const Ensemble data = experiments(oscillator(40), options);
  const Verdict v = verdict(identify(data, {.lags = 2}).model, data);
  EXPECT_EQ(v.trust, Trust::look_closer);
  EXPECT_TRUE(contains(all_reasons(v), "only on its training data: 10 experiments for 10 unknowns")) << all_reasons(v);
}

const VerdictCheck& check_of(const Verdict& verdict, const std::string& name) {
  for (const VerdictCheck& check : verdict.checks)
    if (to_string(check.kind) == name) return check;
  throw std::runtime_error("no check " + name);
}

TEST(Verdict, DoesNotTrustAWrongModel) {
  Model wrong = oscillator(40);
  for (Step& step : wrong.step) step.B() = -step.B();
  const Verdict v = verdict(wrong, noisy(20, 5));
  EXPECT_EQ(v.trust, Trust::distrust);
  EXPECT_EQ(check_of(v, "gains").result, Trust::distrust);
}

TEST(Verdict, LooksCloserAtEffectsThatAreALittleWrong) {
  Model wrong = oscillator(40);
  for (Step& step : wrong.step) step.B() *= 0.7;
  EXPECT_EQ(check_of(verdict(wrong, noisy(60, 5)), "gains").result, Trust::look_closer);
}

// Here the noise would not make the simulation of an exact model bad.
TEST(Verdict, DoesNotTrustAWrongSimulation) {
  const ExperimentOptions options{.experiments = 20, .seed = 8, .measurement_noise = 0.01};
  Model wrong = with_noise(oscillator(40), options);
  const Ensemble data = experiments(wrong, options);
  for (Step& step : wrong.step) step.B() = -step.B();
  EXPECT_EQ(check_of(verdict(wrong, data), "simulation_fit").result, Trust::distrust);
}

// Both models predict well all the same.
TEST(Verdict, ReadsTheInnovations) {
  const ExperimentOptions options{.experiments = 40, .seed = 8, .process_noise = 0.02, .measurement_noise = 0.05};
  const Model truth = with_noise(oscillator(40), options);
  const Ensemble data = experiments(truth, options);
  EXPECT_EQ(verdict(truth, data).trust, Trust::good) << all_reasons(verdict(truth, data));
  Model overconfident = truth;
  for (Step& step : overconfident.step) step.set_innovation_cov(0.4 * step.innovation_cov());
  Verdict v = verdict(overconfident, data);
  EXPECT_EQ(v.trust, Trust::look_closer);
  EXPECT_TRUE(contains(all_reasons(v), "Squared innovations: 2.49 times the stated covariance") &&
              contains(all_reasons(v), "the model is overconfident"))
      << all_reasons(v);
  Model wrong = truth;
  for (Step& step : wrong.step) step.D()(0, 0) += 0.05;
  v = verdict(wrong, data);
  EXPECT_EQ(v.trust, Trust::look_closer);
  EXPECT_TRUE(contains(all_reasons(v), "p < 0.0001: the inputs explain part of the innovations, correlation up to 0."))
      << all_reasons(v);
  EXPECT_TRUE(contains(all_reasons(v), "at lag 0.")) << all_reasons(v);
  const std::string page = report_page(wrong, data).html;
  EXPECT_TRUE(contains(page, "squared innovations over their stated covariance"));
  EXPECT_TRUE(contains(page, "the inputs explain part of the innovations"));
  EXPECT_TRUE(contains(page, "no sign of feedback from outputs to inputs"));
}

// The page, the verdict and validate() have one number and one conclusion for each test, and the headline holds what
// they conclude: models that are right, a little wrong and wrong, on few and many experiments.
TEST(ReportPage, SaysOfEachTestWhatValidateSays) {
  int silent = 0, small = 0, loud = 0;
  for (const double error : {0.0, 0.01, 0.05, 0.3})
    for (const Index count : {20, 200}) {
      const ExperimentOptions options{
          .experiments = count, .seed = 8, .process_noise = 0.02, .measurement_noise = 0.05};
      Model model = with_noise(oscillator(40), options);
      const Ensemble data = experiments(model, options);
      for (Step& step : model.step) step.D()(0, 0) += error;
      const ReportPage page = report_page(model, data);
      const Conclusions found = conclusions(validate(model, data), model.names);
      std::string text = page.html;
      for (const auto& [mark, plain] : {std::pair("&nbsp;", " "), std::pair("&#8288;", "")})
        for (size_t at; (at = text.find(mark)) != std::string::npos;) text.replace(at, std::string(mark).size(), plain);
      bool against = false, negligible = false;
      for (const Conclusion& c : found.all()) {
        const std::string sentence = in_words(c);
        EXPECT_TRUE(contains(text, escape(sentence))) << sentence;
        EXPECT_EQ(contains(all_reasons(page.verdict), sentence), c.result == TestResult::against) << sentence;
        against = against || c.result == TestResult::against;
        negligible = negligible || c.result == TestResult::negligible;
      }
      const bool none = contains(page.html, "No check of this page speaks against the model.");
      EXPECT_EQ(none, page.verdict.reasons.empty() && !negligible) << error;
      EXPECT_EQ(contains(page.html, "No check speaks against the model."), page.verdict.reasons.empty() && negligible);
      if (against) {
        EXPECT_NE(page.verdict.trust, Trust::good);
      }
      silent += none, small += negligible && page.verdict.reasons.empty(), loud += against;
    }
  EXPECT_TRUE(silent > 0 && small > 0 && loud > 0) << silent << " " << small << " " << loud;
}

TEST(Verdict, SaysWhereAnInputRests) {
  Random random(6);
  Model system = constant_system({4, 2, 2}, 60, 0.9, 6);
  // Well seen and well reached, so that nothing but the input is to blame.
  Matrix A(4, 4), B(4, 2), C(2, 4);
  A << 0.8, 0.3, 0, 0, -0.3, 0.8, 0, 0, 0, 0, 0.7, 0.2, 0, 0, -0.2, 0.6;
  B << 1, 0, 0, 0.5, 0.3, 1, 0, 0.7;
  C << 1, 0, 0.5, 0, 0, 1, 0, 0.8;
  for (size_t k = 0; k < 60; ++k)
    system.step[k].A() = A, system.step[k].B() = B, system.step[k].C() = C, system.step[k].D().setZero();
  Ensemble data = random_experiments(system, 60, 6);
  for (Index k = 41; k < 45; ++k) data.input(k).col(1) = (1.5 + 1e-4 * random.matrix(60, 1).array()).matrix();
  data.names.input_names = {"elevator", "throttle"};
  const Ensemble clean = simulate(system, data);
  for (Index k = 0; k < data.steps(); ++k) data.output(k) = clean.output(k) + 0.02 * random.matrix(60, 2);
  const Model model =
      identify(data,
               {.states = 4, .lags = 3, .method = Method::tvera, .nominal = NominalChoice::none, .hold_out = 0.25})
          .model;
  const Verdict v = verdict(model, data);
  EXPECT_NE(v.trust, Trust::good);
  // Windows with two or more resting steps: 42 and on, as far as they reach back.
  EXPECT_TRUE(
      contains(v.summary, "are ill-conditioned: input throttle is nearly the same in all experiments at steps 41–44"))
      << v.summary;
  EXPECT_TRUE(contains(v.summary, "15 held-out experiments"));
  EXPECT_FALSE(contains(all_reasons(v), "elevator"));
}

// u(k) = -0.5 y(k-1) + dither: a first-order system in a loop.
Ensemble in_closed_loop(Index count, double dither, std::uint64_t seed) {
  Ensemble e(count, 60, 1, 1);
  e.dt = 0.1;
  e.initial_state = InitialState::unknown;
  Random random(seed);
  for (Index n = 0; n < count; ++n) {
    double x = random.normal(), before = 0.0;
    for (Index k = 0; k < 60; ++k) {
      e.u(n, k, 0) = -0.5 * before + dither * random.normal();
      e.y(n, k, 0) = x + 0.1 * random.normal();
      x = 0.9 * x + 0.4 * e.u(n, k, 0) + 0.2 * random.normal();
      before = e.y(n, k, 0);
    }
  }
  return e;
}

// A loaded model has no warnings of its identification.
TEST(Verdict, InputsThatFollowFromOutputsDoNotShowTheirEffects) {
  for (const Index period : {0, 1, 20}) {
    IdentifyOptions options{.states = 1, .lags = 2, .refine = false};
    options.period = period;
    const Model model = identify(in_closed_loop(60, 0.0, 1), options).model;
    const Verdict found = verdict(model, in_closed_loop(30, 0.0, 2));
    EXPECT_EQ(found.trust, Trust::look_closer) << period;
    const auto check = [&](VerdictCheck::Kind kind) {
      return *std::find_if(found.checks.begin(), found.checks.end(),
                           [&](const VerdictCheck& c) { return c.kind == kind; });
    };
    const VerdictCheck inputs = check(VerdictCheck::Kind::inputs);
    EXPECT_EQ(inputs.result, Trust::look_closer);
    EXPECT_FALSE(inputs.kept());
    EXPECT_TRUE(std::any_of(inputs.reasons.begin(), inputs.reasons.end(), [](const VerdictReason& reason) {
      return reason.text.find("0.5 y1(k-1)") != std::string::npos;
    })) << period;
    EXPECT_EQ(check(VerdictCheck::Kind::gains).untested, VerdictCheck::Untested::dependent_inputs);
    const Verdict excited = verdict(model, in_closed_loop(30, 0.5, 3));
    for (const VerdictCheck& c : excited.checks)
      EXPECT_TRUE(c.kind != VerdictCheck::Kind::inputs || c.result == Trust::good) << period;
  }
}

TEST(Verdict, SwappedAxesCountAgainstTheModel) {
  const Model system = oscillator(60);
  const Ensemble e = experiments(system, {.experiments = 40, .measurement_noise = 0.05});
  const Model model = identify(e, {.states = 4, .lags = 3, .refine = false}).model;
  Ensemble swapped(60, 40, 2, 2);
  for (Index n = 0; n < 40; ++n)
    for (Index k = 0; k < 60; ++k)
      for (Index c = 0; c < 4; ++c) swapped.samples()(k, n * 4 + c) = e.samples()(n, k * 4 + c);
  const Verdict found = verdict(model, swapped);
  EXPECT_TRUE(std::any_of(found.reasons.begin(), found.reasons.end(),
                          [](const std::string& text) { return text.find("swapped") != std::string::npos; }));
}

TEST(Verdict, SaysWhenNothingWasTested) {
  Ensemble data = noisy(5, 7);
  for (Index k = 0; k < data.steps(); ++k) data.output(k).setConstant(nan);
  const Verdict v = verdict(oscillator(40), data);
  EXPECT_EQ(v.trust, Trust::distrust);
  EXPECT_TRUE(contains(v.summary, "Nothing was tested")) << v.summary;
}

TEST(Verdict, OutputsThatRestProveNothing) {
  Model model = oscillator(40);
  for (Step& step : model.step) step.G().setZero();
  // One dead sensor: its perfect or missing fit must not count, and it must be named.
  Ensemble data = noisy(20, 40);
  for (Index k = 0; k < 40; ++k) data.output(k).col(1).setConstant(7.0);
  Verdict v = verdict(model, data);
  EXPECT_NE(v.trust, Trust::good);
  EXPECT_TRUE(contains(all_reasons(v), "Output y2 is constant in these data")) << all_reasons(v);
  // Nothing moves at all, and a model that is absurd reproduces it exactly.
  for (Step& step : model.step) step.D() *= 50;
  for (Index k = 0; k < 40; ++k) data.input(k).setZero(), data.output(k).setZero();
  v = verdict(model, data);
  EXPECT_EQ(v.trust, Trust::distrust);
  EXPECT_TRUE(contains(v.summary, "Nothing was tested: no output varies")) << v.summary;
}

TEST(Verdict, NamesInputsThatNeverVary) {
  Ensemble data = noisy(60, 41);
  for (Index k = 0; k < 40; ++k) data.input(k).col(1).setConstant(0.7);
  data = simulate(oscillator(40), data);
  const Model model = identify(data, {.nominal = NominalChoice::mean, .hold_out = 0.25}).model;
  const Verdict v = verdict(model, data);
  EXPECT_NE(v.trust, Trust::good) << v.summary;
  EXPECT_TRUE(contains(all_reasons(v), "nput u2 is the same in all experiments")) << all_reasons(v);
}

// Two values: experiments agree by chance all the time, and inputs that vary are not to blame.
TEST(Verdict, FewExperimentsWithBinaryInputsAreNoAlarm) {
  for (std::uint64_t seed = 0; seed < 10; ++seed)
    for (const Index count : {3, 4, 6, 10, 20}) {
      Random random(seed);
      Ensemble data(count, 200, 2, 2, 0.05);
      for (Index k = 0; k < 200; ++k) data.input(k) = random.matrix(count, 2).array().sign().matrix();
      const Verdict v = verdict(oscillator(200), simulate(oscillator(200), data));
      EXPECT_FALSE(contains(all_reasons(v), "nearly the same")) << count << " " << all_reasons(v);
    }
}

TEST(Verdict, SaysWhichStepsWereNotTested) {
  Model model = oscillator(60);
  for (Step& step : model.step) step.G().setZero();
  const Verdict v = verdict(model, noisy(20, 42, 20));
  EXPECT_EQ(v.trust, Trust::look_closer) << v.summary;
  EXPECT_TRUE(contains(all_reasons(v), "test only 20 of the model's 60 steps; the data do not test steps 20–59"))
      << all_reasons(v);
}

// What an error of the model at the start is, beside outputs that grow to a hundred times their first size.
TEST(Verdict, FindsStepsThatPooledFiguresHide) {
  const Model system = oscillator(60);
  Model model = identify(noisy(80, 43, 60), {.states = 4, .lags = 4}).model;
  const Verdict sound = verdict(model, noisy(80, 44, 60));
  EXPECT_FALSE(contains(all_reasons(sound), "times the errors of the identification at these steps"))
      << all_reasons(sound);
  for (Index k = 3; k < 8; ++k) model.at(k).D() *= 4;
  const Verdict v = verdict(model, noisy(80, 44, 60));
  EXPECT_TRUE(contains(all_reasons(v), "One-step errors at steps 3–") &&
              contains(all_reasons(v), "times the errors of the identification at these steps"))
      << all_reasons(v);
}

TEST(Verdict, NamesExperimentsThatStandOut) {
  Model model = oscillator(40);
  for (Step& step : model.step) step.G().setZero();
  Ensemble data = noisy(30, 45);
  for (Index k = 0; k < 40; ++k) data.output(k).row(11) *= -1;  // a swapped plug
  const Verdict v = verdict(model, data);
  EXPECT_EQ(v.trust, Trust::look_closer);
  EXPECT_TRUE(contains(all_reasons(v), "Errors of experiment 11 are more than 10 times the median")) << all_reasons(v);
  data.experiment_names.assign(30, "");
  for (Index n = 0; n < 30; ++n) data.experiment_names[size_t(n)] = fmt::format("run {}", n + 1);
  const std::string named = all_reasons(verdict(model, data));
  EXPECT_TRUE(contains(named, "Errors of experiment \"run 12\" (row 11) are more than")) << named;
}

// What is held out is named as in the whole ensemble.
TEST(Verdict, NamesHeldOutExperimentsByTheirRowsInTheData) {
  Ensemble data = noisy(60, 3);
  const Split parts = split(data, 0.25);
  const Index bad = parts.held_out_rows[4];
  for (Index k = 0; k < 40; ++k) data.output(k).row(bad) *= -1;
  const IdentifyOptions options{.states = 4, .method = Method::tvera, .hold_out = 0.25};
  for (const bool named : {false, true}) {
    // Names that are the row numbers of the held-out part.
    if (named) {
      data.experiment_names.clear();
      for (Index n = 0; n < 60; ++n) data.experiment_names.push_back(fmt::format("not held out {}", n));
      for (size_t i = 0; i < parts.held_out_rows.size(); ++i)
        data.experiment_names[size_t(parts.held_out_rows[i])] = std::to_string(i);
    }
    const Identification found = identify(data, options);
    const std::string expected = named ? fmt::format("\"4\" (row {})", bad) : fmt::format("{}", bad);
    const ReportPage page = identification_page(found, data, options);
    for (const Verdict& v : {page.verdict, verdict(found.model, data), verdict(found, data, options)})
      EXPECT_TRUE(contains(all_reasons(v), fmt::format("Errors of experiment {} are more", expected)))
          << all_reasons(v);
    EXPECT_TRUE(contains(page.html, named ? fmt::format("Experiment &quot;4&quot; (row {})", bad)
                                          : fmt::format("Experiment {}</th>", bad)));
    EXPECT_TRUE(contains(page.html, named ? fmt::format("(row {}) (largest error)", bad)
                                          : fmt::format("Experiment {} (largest error)", bad)));
    EXPECT_TRUE(contains(page.html, fmt::format("\"row\":{},\"name\":{}", bad, named ? "\"4\"" : "null")));
  }
}

TEST(Verdict, BlamesAnInputForItsOwnStepsOnly) {
  Random random(46);
  Model model = oscillator(60);
  Ensemble data = noisy(60, 46, 60);
  for (Index k = 41; k < 45; ++k) data.input(k).col(1) = (1.5 + 1e-4 * random.matrix(60, 1).array()).matrix();
  data = simulate(model, data);
  for (Index k = 0; k < 60; ++k) data.output(k) += 0.02 * random.matrix(60, 2);
  for (Step& step : model.step) step.set_lags(2), step.set_condition(10.0);
  for (const size_t k : {10, 43, 44, 45}) model.step[k].set_condition(1e9);
  ReportOptions options;
  options.evaluation = Evaluation::held_out;
  const Verdict v = verdict(model, data, options);
  EXPECT_TRUE(
      contains(v.summary,
               "Steps 43–45 are ill-conditioned: input u2 is nearly the same in all experiments at steps 41–44. "
               "Step 10 is ill-conditioned."))
      << v.summary;
}

TEST(Words, NamesDoNotTurnTheTextAroundThem) {
  EXPECT_EQ(words::quoted("thrust"), "thrust");
  EXPECT_EQ(words::quoted("\u202eevil 99 %"), "evil 99 %");
  EXPECT_EQ(words::quoted("a\u2066b\u2069\u200f\u061c"), "ab");
  EXPECT_EQ(words::quoted("מהירות"), "\u2068מהירות\u2069");
  EXPECT_EQ(words::quoted("Δp–ü"), "Δp–ü");
  EXPECT_EQ(words::quoted(std::string(10'000, 'x')), std::string(80, 'x') + "…");
  EXPECT_EQ(words::quoted("\xFF\xC2"), "\xFF\xC2");  // what is no text is replaced later
}

TEST(Words, FiguresThatRoundUpToATenthPowerHaveNoExponent) {
  EXPECT_EQ(words::figure(9999.7), "10000");
  EXPECT_EQ(words::figure(999.6, 3), "1000");
  EXPECT_EQ(words::figure(0.99999), "1");
  EXPECT_EQ(words::figure(123456.0, 3), "1.23·10⁵");
  EXPECT_EQ(words::figure(12345.0), "1.23·10⁴");
  EXPECT_EQ(words::figure(-1e8), "−10⁸");
}

TEST(Verdict, ComparesTimeAndNames) {
  Model model = oscillator(40);
  Ensemble data = noisy(20, 8);
  data.dt = 0.1;
  model.names.input_names = {"a", "b"};
  data.names.input_names = {"b", "a"};
  const Verdict v = verdict(model, data);
  EXPECT_EQ(v.trust, Trust::look_closer);
  EXPECT_TRUE(contains(all_reasons(v), "The data's dt = 0.1 s differs from the model's dt = 0.05 s."))
      << all_reasons(v);
  EXPECT_TRUE(contains(all_reasons(v), "The data's inputs are named b, a, but the model's inputs are named a, b."))
      << all_reasons(v);
}

TEST(Verdict, CountsMissingSamples) {
  Ensemble data = noisy(20, 24);
  for (Index k = 0; k < 10; ++k) data.output(k).setConstant(nan);  // half of the channels, a quarter of the steps
  const Verdict v = verdict(oscillator(40), data);
  EXPECT_TRUE(contains(all_reasons(v), "12 % of the samples are missing")) << all_reasons(v);
  data.length.assign(20, 40);
  EXPECT_EQ(all_reasons(verdict(oscillator(40), data)), all_reasons(v));
}

TEST(Verdict, DoesNotBlameFreshDataForTheRegressions) {
  Random random(25);
  Model model = oscillator(40);
  Ensemble data = noisy(20, 25);
  for (Step& step : model.step) step.set_condition(10.0);
  model.step[20].set_condition(1e9);
  for (Index k = 18; k < 21; ++k) data.input(k).col(0).setConstant(1.0);
  data = simulate(model, data);
  for (Index k = 0; k < 40; ++k) data.output(k) += 0.02 * random.matrix(20, 2);
  const Verdict v = verdict(model, data);
  EXPECT_TRUE(contains(v.summary, "Step 20 is ill-conditioned.")) << v.summary;
  EXPECT_TRUE(contains(all_reasons(v), "Input u1 is nearly the same in all experiments at steps 18–20"))
      << all_reasons(v);
}

// The checks decide once: status and reasons follow from them, and the page shows the same.
TEST(Verdict, IsTheWorstOfItsChecks) {
  Model good = oscillator(40), wrong = good, ill = good;
  for (Step& step : good.step) step.G().setZero();
  for (Step& step : wrong.step) step.B() = -step.B();
  for (Step& step : ill.step) step.set_condition(10.0), step.set_rank(1), step.set_lags(2);
  ill.step[7].set_condition(1e9);
  Ensemble dead = noisy(20, 40), outlier = noisy(30, 45), silent = noisy(5, 7);
  for (Index k = 0; k < 40; ++k) {
    dead.output(k).col(1).setConstant(7.0);
    outlier.output(k).row(11) *= -1;
    silent.output(k).setConstant(nan);
  }
  struct Expected {
    const Model* model;
    Ensemble data;
    Trust trust;
    std::vector<std::string> failed;
  };
  const Expected cases[] = {{&good, noisy(20, 2), Trust::good, {}},
                            {&good, noisy(1, 9), Trust::look_closer, {"experiments"}},
                            {&good, dead, Trust::look_closer, {"outputs", "whiteness"}},
                            {&good, outlier, Trust::look_closer, {"simulation_fit", "outliers", "whiteness"}},
                            {&good, silent, Trust::distrust, {"outputs"}},
                            {&ill, noisy(20, 2), Trust::look_closer, {"condition", "rank", "whiteness"}},
                            {&wrong,
                             noisy(20, 5),
                             Trust::distrust,
                             {"prediction_fit", "input_effect", "whiteness", "independence", "gains"}}};
  for (const auto& [model, data, trust, failed] : cases) {
    const ReportPage page = report_page(*model, data);
    const Verdict& v = page.verdict;
    Trust worst = Trust::good;
    std::vector<std::string> reasons, names;
    for (const VerdictCheck& check : v.checks) {
      const CheckWords words = in_words(check);
      EXPECT_FALSE(words.subject.empty() || words.found.empty() || words.needed.empty());
      // The figures alone decide whether a check passes.
      if (check.result) {
        EXPECT_EQ(check.kept(), *check.result == Trust::good) << to_string(check.kind);
      }
      EXPECT_EQ(check.result.has_value(), !check.untested.has_value()) << to_string(check.kind);
      // A fit below the limit of distrust is a reason for distrust.
      for (const CheckFigure& figure : check.figures)
        if (!std::isnan(figure.distrust) && check.result) {
          EXPECT_EQ(std::any_of(figure.values.begin(), figure.values.end(),
                                [&](double value) { return value < figure.distrust; }),
                    check.result == Trust::distrust)
              << to_string(check.kind);
        }
      worst = std::max(worst, check.result.value_or(Trust::good));
      Trust own = Trust::good;
      for (const VerdictReason& reason : check.reasons)
        reasons.push_back(reason.text), own = std::max(own, reason.trust);
      if (!check.reasons.empty()) {
        EXPECT_EQ(check.result, own) << to_string(check.kind);
      }
      if (check.result.value_or(Trust::good) == Trust::good) {
        EXPECT_TRUE(check.reasons.empty()) << to_string(check.kind);
      } else {
        names.emplace_back(to_string(check.kind));
      }
      EXPECT_TRUE(contains(page.html, escape(words.subject))) << words.subject;
    }
    EXPECT_EQ(v.trust, worst);
    EXPECT_EQ(v.trust, trust) << all_reasons(v);
    std::vector<std::string> told = v.reasons;
    std::sort(told.begin(), told.end());
    std::sort(reasons.begin(), reasons.end());
    EXPECT_EQ(told, reasons);
    EXPECT_EQ(names, failed) << all_reasons(v);
  }
}

TEST(Verdict, FiguresKeepTheirBounds) {
  using Rule = CheckFigure::Rule;
  const double infinite = std::numeric_limits<double>::infinity();
  const auto kept = [](std::vector<double> values, Rule rule, double bound) {
    return CheckFigure{"fit", std::move(values), rule, bound}.kept();
  };
  for (const auto& [rule, at_bound, above, beneath] : {std::tuple{Rule::at_least, true, true, false},
                                                       {Rule::at_most, true, false, true},
                                                       {Rule::below, false, false, true}}) {
    EXPECT_EQ(kept({2.0}, rule, 2.0), at_bound) << to_string(rule);
    EXPECT_EQ(kept({3.0}, rule, 2.0), above);
    EXPECT_EQ(kept({infinite}, rule, 2.0), above);
    EXPECT_EQ(kept({-infinite}, rule, 2.0), beneath);
    EXPECT_EQ(kept({nan, 1.0}, rule, 2.0), beneath);
    EXPECT_FALSE(kept({1.0, 3.0}, rule, 2.0));
    EXPECT_FALSE(kept({}, rule, 2.0));  // nothing is known
    EXPECT_FALSE(kept({nan}, rule, 2.0));
  }
  VerdictCheck check;
  check.figures = {{"p", {0.5}, Rule::at_least, 0.01}, {"correlation", {0.3}, Rule::below, 0.2}};
  EXPECT_FALSE(check.kept());
  check.one_suffices = true;
  EXPECT_TRUE(check.kept());
}

// A model whose predictions overflow: the fit of the other output does not pass the check.
TEST(Verdict, AnOverflowKeepsNoBound) {
  Model wild = oscillator(40);
  for (Step& step : wild.step) step.C().row(0) *= 1e200;
  const Verdict v = verdict(wild, noisy(20, 2));
  for (const char* name : {"one_step_fit", "simulation_fit"}) {
    const VerdictCheck& check = check_of(v, name);
    EXPECT_EQ(check.result, Trust::distrust) << name;
    EXPECT_FALSE(check.kept()) << name;
  }
}

TEST(Verdict, DoesNotPassWhatItCannotTest) {
  Model model = oscillator(40);
  for (Step& step : model.step) step.G().setZero();
  for (const Index count : {1, 2, 3, 4}) {
    const Verdict v = verdict(model, noisy(count, 9));
    for (const char* name : {"inputs", "outliers"}) {
      const VerdictCheck& check = check_of(v, name);
      EXPECT_EQ(check.result.has_value(), count >= 3) << name << " " << count << " " << in_words(check).found;
      EXPECT_TRUE(check.reasons.empty());
      if (count < 3) {
        EXPECT_TRUE(contains(in_words(check).found, "3")) << in_words(check).found;
      }
    }
    // Even far away, one or two experiments cannot be told from a bad model.
    Ensemble far = noisy(count, 9);
    for (Index k = 0; k < 40; ++k) far.output(k).row(0) *= -1;
    EXPECT_EQ(check_of(verdict(model, far), "outliers").result.has_value(), count >= 3);
  }
  // One or two steps have no usual error.
  for (const Index steps : {1, 2, 3}) {
    Model few = random_system({1, 1, 1}, steps, 0.5, 20);
    few.initial_state = InitialState::zero;
    Ensemble data = random_experiments(few, 5, 22);
    data.initial_state = InitialState::zero;
    EXPECT_EQ(check_of(verdict(few, data), "error_peaks").result.has_value(), steps >= 3) << steps;
  }
}

TEST(Verdict, TakesTheLargestErrorOfOneLongRecordForChance) {
  Model model = constant_system({2, 2, 1}, 4000, 0.5, 3);
  model.period = 1;
  for (Step& step : model.step) step.G().setZero();
  const Ensemble rest = random_experiments(model, 1, 4);
  for (const unsigned seed : {11, 12, 13}) {
    Ensemble data = with_noise(rest, 0.1, seed);
    for (Index k = 0; k < 4000; ++k) data.output(k).col(1) = rest.output(k).col(1);  // without noise
    EXPECT_EQ(check_of(verdict(model, data), "error_peaks").result, Trust::good);
    data.output(2000).array() += 2.0;
    EXPECT_EQ(check_of(verdict(model, data), "error_peaks").result, Trust::look_closer);
  }
}

TEST(Verdict, TestsTheInputsOfPeriodicModelsOverTime) {
  Model model = constant_system({3, 2, 2}, 40, 0.8, 6);
  model.period = 1;
  for (const Index count : {1, 5}) {
    Ensemble data = random_experiments(model, count, 7);
    const VerdictCheck varied = check_of(verdict(model, data), "inputs");
    EXPECT_EQ(varied.result, Trust::good);
    EXPECT_EQ(in_words(varied).found, "2 of 2 inputs");
    EXPECT_TRUE(contains(in_words(varied).subject, "over time")) << in_words(varied).subject;
    for (Index k = 0; k < 40; ++k) data.input(k).col(1).setConstant(0.7);
    const VerdictCheck constant = check_of(verdict(model, simulate(model, data)), "inputs");
    EXPECT_EQ(constant.result, Trust::look_closer);
    EXPECT_EQ(in_words(constant).found, "1 of 2 inputs");
    ASSERT_EQ(constant.reasons.size(), 1u);
    EXPECT_TRUE(contains(constant.reasons[0].text, "Input u2 is constant in these data")) << constant.reasons[0].text;
  }
}

// Conclusions that fail or pass for each of their reasons: the words state the rule of that reason.
TEST(Verdict, StatesTheRuleThatDecidedATestOfTheInnovations) {
  using Reason = Conclusion::Reason;
  const ExperimentOptions options{.experiments = 40, .seed = 8, .process_noise = 0.02, .measurement_noise = 0.05};
  const Model model = with_noise(oscillator(40), options);
  const report::Tested tested = report::tested(model, experiments(model, options), {});
  const report::Evidence found = report::evidence(model, tested);
  const auto stated = [&](Validation v) {
    report::Evidence changed = found;
    changed.conclusions = conclusions(v, model.names);
    changed.validation = std::move(v);
    return report::verdict_of(model, changed, tested.options);
  };
  const auto expect = [](const VerdictCheck& check, std::optional<Trust> result, const std::string& text,
                         const std::string& needed) {
    EXPECT_EQ(check.result, result) << to_string(check.kind);
    EXPECT_EQ(check.kept(), result == Trust::good) << to_string(check.kind);
    EXPECT_EQ(in_words(check).found, text);
    EXPECT_EQ(in_words(check).needed, needed);
  };
  Validation v = found.validation;
  v.whiteness.p = 0.3;
  v.whiteness.bound.setConstant(0.1);
  v.whiteness.correlation.setZero();
  expect(check_of(stated(v), "whiteness"), Trust::good, "p = 0.3", "p of 0.01 or more");
  v.whiteness.correlation(1, 0) = -0.31;  // of one sign at many steps: p does not show it
  EXPECT_EQ(conclusions(v, model.names).whiteness.reason, Reason::correlated_on_average);
  expect(check_of(stated(v), "whiteness"), Trust::look_closer,
         "correlation 0.31 on average over the steps, beyond its bound",
         "no correlation beyond 1.5 times its bound, or a correlation below 0.2");
  v.whiteness.p = 0.002;
  expect(check_of(stated(v), "whiteness"), Trust::look_closer, "p = 0.002, correlation 0.31",
         "p of 0.01 or more, or a correlation below 0.2");
  v.squares.ratio = 12;
  v.squares.p = 0.2;
  EXPECT_EQ(conclusions(v, model.names).nis.reason, Reason::size_of_experiments);
  expect(check_of(stated(v), "nis"), Trust::look_closer, "12 times the stated covariance, p = 0.2",
         "10 times the stated covariance or less, for p of 0.01 or more");
  v.squares.ratio = 5;
  expect(check_of(stated(v), "nis"), Trust::good, "5 times the stated covariance, p = 0.2",
         "10 times the stated covariance or less, for p of 0.01 or more");
  v.squares.p = 0.002;
  expect(check_of(stated(v), "nis"), Trust::look_closer, "5 times the stated covariance, p = 0.002",
         "2 times the stated covariance or less, for p below 0.01");
  v.gains.error = Vector{{0.5, 0.0}};
  v.gains.deviation = Vector{{0.1, 0.1}};
  v.gains.share = Vector{{0.9, 0.9}};
  expect(check_of(stated(v), "gains"), Trust::look_closer, "significant error of 45 % of the simulated outputs",
         "no significant error, or one below 20 %");
  v.gains.share = Vector{{0.3, 0.9}};
  expect(check_of(stated(v), "gains"), Trust::good, "significant error of 15 % of the simulated outputs",
         "no significant error, or one below 20 %");
  v.gains.deviation = Vector{{0.8, 0.1}};
  v.gains.share = Vector{{0.9, 0.9}};  // 0.9 · 0.8 times the quantile of 99 %, 2.576
  expect(check_of(stated(v), "gains"), Trust::look_closer, "99 % interval of ± 185 % of the simulated outputs",
         "± 50 % or less");
}

// The figures of the checks against formulas of their own, on noisy data that the model does not fit exactly.
TEST(Verdict, HasTheFiguresOfTheData) {
  for (const std::uint64_t seed : {3, 4, 5}) {
    const Index count = 12, steps = 40, m = 2;
    const ExperimentOptions options{
        .experiments = count, .seed = seed, .process_noise = 0.02, .measurement_noise = 0.05};
    Model model = with_noise(oscillator(steps), options);
    Ensemble data = experiments(model, options);
    for (Step& step : model.step) step.set_lags(2);
    for (Index j = 0; j < m; ++j) data.y(5, 17, j) += 8.0;
    for (Index k = 0; k < steps; ++k) data.output(k).row(2) *= 1.5;
    ReportOptions asked;
    asked.evaluation = Evaluation::given;
    asked.identified_from = 60;
    const Verdict v = verdict(model, data, asked);
    const Prediction predicted = predict(model, data);
    const Ensemble simulated = simulate_data(model, data);
    const Vector spread = [&] {
      Vector squares = Vector::Zero(m), mean = Vector::Zero(m);
      for (Index k = 0; k < steps; ++k) mean += data.output(k).colwise().sum().transpose();
      mean /= double(count * steps);
      for (Index k = 0; k < steps; ++k)
        squares += (data.output(k).rowwise() - mean.transpose()).colwise().squaredNorm().transpose();
      return Vector((squares / double(count * steps)).cwiseSqrt());
    }();
    const auto scaled = [&](Index k, const Ensemble& computed) {
      return Matrix((data.output(k) - computed.output(k)) * spread.cwiseInverse().asDiagonal());
    };
    const auto largest = [](const std::vector<double>& values) {
      return std::max_element(values.begin(), values.end()) - values.begin();
    };
    const auto median = [](std::vector<double> values) {
      std::sort(values.begin(), values.end());
      return values[values.size() / 2];  // of an even number, the upper one of the two in the middle
    };
    std::vector<double> step_error, peak, excess, stated;
    for (Index k = 0; k < steps; ++k) {
      const Matrix e = scaled(k, predicted.y);
      step_error.push_back(std::sqrt(e.squaredNorm() / double(e.size())));
      const Vector variance = model.at(k).innovation_cov().diagonal();
      stated.push_back(std::sqrt(variance.cwiseQuotient(spread.cwiseAbs2()).mean()));
      const Matrix own = predicted.innovations[size_t(k)] * variance.cwiseSqrt().cwiseInverse().asDiagonal();
      excess.push_back(std::sqrt(own.squaredNorm() / double(own.size())));
    }
    for (Index k = 0; k < steps; ++k)
      peak.push_back(step_error[size_t(k)] / std::max({0.05, 5 * median(step_error), 2 * stated[size_t(k)]}));
    const auto at_step = [&](const std::vector<double>& values) {
      return fmt::format("{} at step {}", words::figure(values[size_t(largest(values))], 3), largest(values));
    };
    EXPECT_EQ(in_words(check_of(v, "error_peaks")).found, at_step(peak));
    EXPECT_EQ(check_of(v, "error_peaks").result == Trust::good, peak[size_t(largest(peak))] <= 1);
    EXPECT_EQ(in_words(check_of(v, "beyond_noise")).found, at_step(excess));
    EXPECT_EQ(in_words(check_of(v, "beyond_noise")).needed, "5 or less");
    EXPECT_EQ(check_of(v, "beyond_noise").result,
              excess[size_t(largest(excess))] > 5 ? Trust::look_closer : Trust::good);
    EXPECT_EQ(largest(excess), 17);
    EXPECT_EQ(in_words(check_of(v, "coverage")).found, "40 of 40 steps");
    EXPECT_EQ(in_words(check_of(v, "coverage")).needed, "90 % or more");
    EXPECT_EQ(in_words(check_of(v, "samples")).found, words::figure(60.0 / double(unknowns(model, 20)), 3));
    EXPECT_EQ(in_words(check_of(v, "samples")).needed, "2 or more");
    ASSERT_EQ(v.horizon, 0);
    std::vector<double> excess_of_experiments(size_t(count), 0.0);
    for (const Ensemble* computed : {&simulated, &predicted.y}) {
      std::vector<double> error(size_t(count), 0.0);
      for (Index k = 0; k < steps; ++k) {
        const Matrix e = scaled(k, *computed);
        for (Index n = 0; n < count; ++n) error[size_t(n)] += e.row(n).squaredNorm() / double(steps * m);
      }
      for (double& e : error) e = std::sqrt(e);
      const double limit = std::max(0.05, 10 * median(error));
      for (size_t n = 0; n < error.size(); ++n)
        excess_of_experiments[n] = std::max(excess_of_experiments[n], error[n] / limit);
    }
    const auto worst = largest(excess_of_experiments);
    EXPECT_EQ(in_words(check_of(v, "outliers")).found,
              fmt::format("{} at experiment {}", words::figure(excess_of_experiments[size_t(worst)], 3), worst));
  }
}

// A small fit passes if the noise explains it, but only if cross-validation finds no better regression.
TEST(Verdict, LetsNoiseExplainSmallFitsIfNoRegressionIsBetter) {
  Model model = constant_system({1, 1, 1}, 50, 0.98, 1);
  for (Step& step : model.step)
    step.A()(0, 0) = 0.98, step.B()(0, 0) = 0.3, step.C()(0, 0) = 1.0, step.D()(0, 0) = 0.0;
  const ExperimentOptions noise{.experiments = 40, .seed = 1, .process_noise = 0.5, .measurement_noise = 1.5};
  model = with_noise(model, noise);
  const Ensemble data = experiments(model, noise);
  const auto result = [&](std::optional<double> ratio) {
    ReportOptions options;
    if (ratio) {
      const Vector one = Vector::Ones(1), none = Vector::Zero(1);
      options.comparison = RegressionComparison{
          .horizons = {1}, .experiments = 40, .model = {*ratio * one, none}, .regression = {one, none}};
    }
    const Verdict v = verdict(model, data, options);
    const VerdictCheck& check = check_of(v, "prediction_fit");
    EXPECT_LT(check.figures[0].values[0], 80);
    EXPECT_EQ(check.one_suffices, check.result == Trust::good);
    return check.result;
  };
  EXPECT_EQ(result(std::nullopt), Trust::look_closer);
  EXPECT_EQ(result(1.3), Trust::look_closer);
  EXPECT_EQ(result(1.0), Trust::good);
}

// Noise that drives a slow system: predictions decide. The effect of the inputs is the response to the inputs'
// departures from their mean, from zero states, in the last of H steps, over the error of predictions over H steps.
TEST(Verdict, HasTheFiguresOfPredictionsThatDecide) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const double effect : {0.01, 3.0}) {
      const Index count = 12, steps = 50;
      Model model = constant_system({1, 1, 1}, steps, 0.98, seed);
      for (Step& step : model.step) {
        step.A()(0, 0) = 0.98, step.B()(0, 0) = 0.1 * effect, step.C()(0, 0) = 1.0, step.D()(0, 0) = 0.0;
      }
      const ExperimentOptions options{
          .experiments = count, .seed = seed, .process_noise = 0.5, .measurement_noise = 0.02};
      model = with_noise(model, options);
      const Ensemble data = experiments(model, options);
      const Verdict v = verdict(model, data);
      ASSERT_GT(v.horizon, 0) << v.summary;
      Ensemble ahead = predict(model, data, {v.horizon, std::nullopt}).y;
      const Index begin = validate(model, data).first_predicted;
      const Fit expected = fit(data, ahead, model.y_nominal, begin + v.horizon - 1);
      EXPECT_EQ(in_words(check_of(v, "prediction_fit")).found, words::percent_range(expected.fit));
      EXPECT_EQ(in_words(check_of(v, "prediction_fit")).needed, "80 % or more for every output");
      double squares = 0.0;
      const Index starts = steps - begin - v.horizon + 1;
      for (Index s = begin; s < begin + starts; ++s) {
        Vector x = Vector::Zero(count), y = x;
        for (Index k = s; k < s + v.horizon; ++k) {
          const Vector u = data.input(k).col(0).array() - data.input(k).col(0).mean();
          y = model.at(k).C()(0, 0) * x + model.at(k).D()(0, 0) * u;
          x = model.at(k).A()(0, 0) * x + model.at(k).B()(0, 0) * u;
        }
        squares += y.squaredNorm() / double(count);
      }
      const double ratio = std::sqrt(squares / double(starts)) / expected.rmse(0);
      const VerdictCheck& input = check_of(v, "input_effect");
      EXPECT_EQ(in_words(input).found, words::figure(ratio, 3));
      EXPECT_EQ(in_words(input).needed, "0.5 or more");
      EXPECT_EQ(input.result, ratio < 0.5 ? Trust::look_closer : Trust::good);
    }
}

// Half of an output is an offset of each experiment, which the model does not have. The simulation fits to less than
// 50 %, and predictions ten steps ahead are good: the observer takes the offset for a part of the state.
TEST(Verdict, StatesNoLimitOfDistrustWhereAnExceptionApplies) {
  Model model = constant_system({1, 1, 1}, 200, 0.999, 1);
  for (Step& step : model.step) {
    step.A()(0, 0) = 0.999, step.B()(0, 0) = 0.1, step.C()(0, 0) = 1.0, step.D()(0, 0) = 0.0;
    step.G()(0, 0) = -0.9;
  }
  model.initial_state = InitialState::zero;
  Ensemble data = simulate(model, random_experiments(model, 20, 3));
  data.initial_state = InitialState::zero;
  Random random(4);
  for (Index n = 0; n < 20; ++n) {
    const double start = random.normal();
    for (Index k = 1; k < 200; ++k) data.y(n, k, 0) += start * std::pow(0.999, double(k - 1));
  }
  // The model states little noise, so that its simulation decides.
  for (Step& step : model.step) step.set_innovation_cov(Matrix::Constant(1, 1, 1e-8));
  const Verdict v = verdict(model, data);
  ASSERT_EQ(v.horizon, 0) << v.summary;
  const VerdictCheck& excused = check_of(v, "simulation_fit");
  ASSERT_LT(excused.figures.front().values.front(), 50) << v.summary;
  EXPECT_EQ(excused.result, Trust::look_closer) << all_reasons(v);
  EXPECT_TRUE(std::isnan(excused.figures.front().distrust));
  const std::string page = report_page(model, data).html;
  EXPECT_TRUE(contains(page, "if predictions 10&nbsp;steps ahead have a fit") ||
              contains(page, "if predictions 10 steps ahead have a fit"));
  // Without an exception the limit is there.
  Model wrong = model;
  for (Step& step : wrong.step) step.B()(0, 0) = -1.0;
  EXPECT_EQ(check_of(verdict(wrong, data), "simulation_fit").figures.front().distrust, 50);
}

TEST(Verdict, HasTheSpreadOfEachInput) {
  Model model = oscillator(40);
  Ensemble data = noisy(20, 2);
  data.input(9).col(1) *= 1e-3;
  const VerdictCheck check = check_of(verdict(model, simulate(model, data)), "inputs");
  ASSERT_EQ(check.figures.size(), 3u);
  EXPECT_EQ(check.figures[2].name, "dependent");
  EXPECT_EQ(check.figures[1].name, "spread");
  EXPECT_EQ(check.figures[1].bound, 0.02);
  ASSERT_EQ(check.figures[1].values.size(), 2u);
  std::vector<double> spread;
  double scaled = 0.0;
  for (Index k = 0; k < 40; ++k) {
    const Vector u = data.input(k).col(1);
    spread.push_back(std::sqrt((u.array() - u.mean()).square().sum() / 19));
    if (k == 9) scaled = spread.back();
  }
  std::sort(spread.begin(), spread.end());
  // Sums of 20 squares, and their roots: rounding errors below 100 ε. The upper one of two middle values is the median.
  EXPECT_NEAR(check.figures[1].values[1], scaled / spread[20], 100 * epsilon * scaled / spread[20]);
  EXPECT_GT(check.figures[1].values[0], 0.02);
  EXPECT_EQ(check.result, Trust::look_closer);
  EXPECT_TRUE(contains(in_words(check).needed, "a spread of 2 % or more")) << in_words(check).needed;
}

TEST(Verdict, WordsNeedTheReasonOfATest) {
  VerdictCheck check;
  check.kind = VerdictCheck::Kind::whiteness;
  check.figures = {{"p", {0.5}, CheckFigure::Rule::at_least, 0.01}};
  check.result = Trust::good;
  EXPECT_TRUE(contains(message([&] { in_words(check); }), "check: whiteness without a reason found"));
  check.reason = Conclusion::Reason::white;
  EXPECT_EQ(in_words(check).found, "p = 0.5");
  check.reason.reset();
  check.untested = VerdictCheck::Untested::innovations;
  EXPECT_THROW(in_words(check), std::invalid_argument);
}

// The findings of a page have each sentence of its list of warnings once, with the rows of the given data.
TEST(ReportPage, HasItsFindings) {
  Ensemble data = noisy(30, 2);
  const Vector u = data.samples().row(4);
  data.samples().row(7) = u.transpose();  // a copy, which is left out
  data.y(20, 25, 0) += 40.0;              // an outlying sample in a later row
  ReportOptions options;
  options.findings = remarks(oscillator(40), data);
  const ReportPage page = report_page(oscillator(40), data, options);
  const std::vector<std::string> texts = in_words(page.findings);
  for (const std::string& text : texts) EXPECT_EQ(std::count(texts.begin(), texts.end(), text), 1) << text;
  const auto one = std::find_if(page.findings.begin(), page.findings.end(),
                                [](const Finding& f) { return f.kind == Finding::Kind::samples_outlying; });
  ASSERT_NE(one, page.findings.end());
  EXPECT_EQ(one->experiments.front().row, 20);
  EXPECT_EQ(std::count_if(page.findings.begin(), page.findings.end(),
                          [](const Finding& f) { return f.kind == Finding::Kind::experiments_copied; }),
            1);
}

// A model that is wrong before the first step of the fits has the fits of the right one.
TEST(Verdict, ItsFitsBeginAtTheGivenStep) {
  Model model = oscillator(40);
  for (Step& step : model.step) step.G().setZero();
  Model off = model;
  for (Index k = 0; k < 20; ++k) off.at(k).C() *= 2, off.at(k).D() *= 2;
  const Ensemble data = noisy(20, 2);
  ReportOptions late;
  late.first_step = 20;
  for (const char* name : {"one_step_fit", "simulation_fit"}) {
    const std::string expected = in_words(check_of(verdict(model, data, late), name)).found;
    EXPECT_EQ(in_words(check_of(verdict(off, data, late), name)).found, expected);
    EXPECT_NE(in_words(check_of(verdict(off, data), name)).found, expected);
  }
  EXPECT_TRUE(contains(report_page(model, data, late).html, "The fits begin at step 20."));
  late.compare = {{"other", off}};
  EXPECT_EQ(report::compare_models(model, data, report::tested(model, data, late)).from, 20);
  late.first_step = 40;
  EXPECT_TRUE(contains(message([&] { verdict(model, data, late); }), "first_step: 40 found, 0 to 39 needed"));
}

// The errors of the simulation grow over the steps, so that late steps have larger ones, also with an exact model.
TEST(Verdict, PredictionsThatDecideBeginAtTheGivenStep) {
  Model model = constant_system({1, 1, 1}, 50, 0.98, 1);
  for (Step& step : model.step) step.A()(0, 0) = 0.98, step.B()(0, 0) = 0.1, step.C()(0, 0) = 1.0, step.D()(0, 0) = 0.0;
  const ExperimentOptions options{.experiments = 12, .seed = 1, .process_noise = 0.5, .measurement_noise = 0.02};
  model = with_noise(model, options);
  const Ensemble data = experiments(model, options);
  ReportOptions late;
  late.first_step = 25;
  const report::DecidingHorizon all = report::evidence(model, report::tested(model, data, {})).deciding,
                                found = report::evidence(model, report::tested(model, data, late)).deciding;
  ASSERT_GT(found.steps, 0);
  const Fit expected = fit(data, predict(model, data, {found.steps, std::nullopt}).y, model.y_nominal,
                           late.first_step + found.steps - 1);
  EXPECT_EQ(found.fit.samples, expected.samples);
  EXPECT_EQ(found.fit.fit, expected.fit);
  EXPECT_LT(found.expected_simulation(0), all.expected_simulation(0));
}

// One comparison gives what the functions of validation and verdict give. Experiment 7 is a copy of experiment 4, and
// experiment 11 an outlier. The verdicts are on all experiments, on held-out ones, and on those without the outlier.
TEST(Validated, IsTheValidationAndTheVerdict) {
  Ensemble data = noisy(60, 3), fresh = noisy(20, 4);
  for (Ensemble* one : {&data, &fresh})
    for (Index k = 0; k < 40; ++k) {
      one->output(k).row(11) *= -1;
      const Vector u = one->input(k).row(4), y = one->output(k).row(4);
      one->input(k).row(7) = u.transpose();
      one->output(k).row(7) = y.transpose();
    }
  for (Index k = 0; k < 40; ++k) fresh.y(9, 20, 0) = 40.0;  // one outlying sample, after a row that is left out
  IdentifyOptions all{.states = 4, .method = Method::tvera}, held_out = all, without = all;
  held_out.hold_out = 0.25;
  without.outliers = OutlierChoice::drop;
  for (const IdentifyOptions& options : {all, held_out, without}) {
    const Model model = identify(data, options).model;
    for (const Ensemble* tested : {&data, &fresh})
      for (const Index horizon : {1, 4, 12}) {
        ReportOptions asked;
        asked.horizon = std::max(asked.horizon, horizon);
        asked.first_step = 5;
        const report::Validated found = report::validated(model, *tested, horizon, asked);
        const Validation expected = validate_distinct(model, *tested, {.horizon = horizon, .first_step = 5});
        const Verdict v = verdict(model, *tested, asked);
        EXPECT_EQ(found.verdict.summary, v.summary);
        EXPECT_EQ(found.verdict.reasons, v.reasons);
        EXPECT_EQ(json_of(found.verdict.checks).dump(), json_of(v.checks).dump());
        EXPECT_EQ(in_words(found.validation.findings), in_words(expected.findings));
        EXPECT_EQ(found.seen, has_seen(model.provenance, *tested));
        EXPECT_EQ(found.rows, used_experiments(*tested).rows);
        EXPECT_EQ(found.rows.size() + 1, size_t(tested->experiments()));
        EXPECT_EQ(found.fits.experiments(), Index(found.rows.size()));
        for (const auto member : {&Validation::simulation, &Validation::one_step, &Validation::horizon})
          for (Index j = 0; j < 2; ++j) {
            const double fit = (expected.*member).fit(j);
            // Both sum up fewer than 60 · 40 squares, in another order. The fit is 100 times a root of their quotient.
            EXPECT_NEAR((found.validation.*member).fit(j), fit, 2400 * epsilon * (200 + std::abs(fit)));
            EXPECT_EQ((found.validation.*member).samples, (expected.*member).samples);
          }
        ASSERT_EQ(found.validation.outlying.size(), expected.outlying.size());
        for (size_t i = 0; i < expected.outlying.size(); ++i)
          EXPECT_EQ(found.validation.outlying[i].experiment, expected.outlying[i].experiment);
      }
  }
}

TEST(Verdict, CountsOneExperimentAsHardlyATest) {
  const Verdict v = verdict(oscillator(40), noisy(1, 9));
  EXPECT_EQ(v.trust, Trust::look_closer);
  EXPECT_TRUE(contains(all_reasons(v), "tested on only one experiment")) << all_reasons(v);
}

// Whole pages

// The data in a page, once it is found to be JSON.
nlohmann::json page_data(const std::string& html) {
  const std::string open = "<script type=\"application/json\" id=\"report-data\">";
  const size_t begin = html.find(open) + open.size();
  return nlohmann::json::parse(html.substr(begin, html.find("</script>", begin) - begin));
}

TEST(ReportPage, IsOfBoundedSizeAndSaysWhatItLeavesOut) {
  const Model system = random_system({6, 4, 3}, 2000, 0.9, 10);
  Ensemble data = random_experiments(system, 150, 11);
  const std::string html = report_page(system, data).html;
  EXPECT_LT(html.size(), 6'000'000u);
  const nlohmann::json found = page_data(html);
  EXPECT_EQ(found["traces"]["experiments"].size(), 24u);
  EXPECT_TRUE(contains(html, "24 of 150 experiments"));
  EXPECT_GT(found["traces"]["stretch"], 1);
  EXPECT_TRUE(contains(html, "least and largest value of every"));
  // Whatever the number of channels: an experiment of 200 of them.
  const Model wide = random_system({2, 100, 100}, 1500, 0.5, 12);
  EXPECT_LT(report_page(wide, random_experiments(wide, 3, 13)).html.size(), 6'000'000u);
}

TEST(ReportPage, LoadsNothing) {
  const std::string html = report_page(oscillator(20), noisy(5, 14, 20)).html;
  for (const char* part : {"src=\"", "url(", "@import", "fetch(", "XMLHttpRequest", "innerHTML =", "eval("})
    EXPECT_EQ(html.find(part), std::string::npos) << part;
  EXPECT_TRUE(contains(html, "Copyright (c) 2022 Leon Sorokin"));  // the licence of what is inlined
}

TEST(ReportPage, KeepsNamesAsText) {
  const std::string nasty = "</script><img src=x onerror=alert(1)>";
  Model model = oscillator(20);
  Ensemble data = noisy(5, 15, 20);
  model.names.output_names = {nasty, "\"y\" \xFF"};
  ReportOptions options;
  options.model_name = options.data_name = nasty;
  options.findings = {{.kind = Finding::Kind::reader_remark, .detail = nasty}};
  const std::string html = report_page(model, data, options).html;
  EXPECT_FALSE(contains(html, "<img"));
  EXPECT_EQ(page_data(html)["outputs"][0]["name"], nasty);
}

TEST(ReportPage, HoldsTheMeasuredSamplesWithTheirGaps) {
  Ensemble data = noisy(3, 16, 20);
  data.y(1, 7, 0) = nan;
  const nlohmann::json found = page_data(report_page(oscillator(20), data).html);
  const auto& e = found["traces"]["experiments"];
  ASSERT_EQ(e.size(), 3u);
  EXPECT_TRUE(e[1]["y"][0][7].is_null());
  for (Index k = 0; k < 20; ++k)
    EXPECT_NEAR(e[2]["y"][1][size_t(k)], data.y(2, k, 1), 5.1e-6 * std::abs(data.y(2, k, 1)));  // six digits
}

TEST(ReportPage, EigenvaluesAreThoseOfTheFrame) {
  // In raw coordinates, which change from step to step, those of A_k would be others.
  Model system = random_system({3, 2, 2}, 30, 0.9, 17);
  Random random(18);
  for (Step& step : system.step) step.G() = 0.3 * random.matrix(3, 2);
  const nlohmann::json data = page_data(report_page(system, random_experiments(system, 4, 18)).html);
  EXPECT_EQ(data["poles"]["frame"], "reference");
  const FramedModel framed = reference_frame(system, 0, 2);
  const auto moduli = [](const Matrix& a) {
    std::vector<double> result;
    for (const auto& value : linalg::eigenvalues(a)) result.push_back(std::abs(value));
    std::sort(result.begin(), result.end());
    return result;
  };
  const Index k = framed.begin + 4;
  for (const auto& [name, a] :
       {std::pair{"open", Matrix(framed.model.at(k).A())}, {"closed", framed.model.at(k).closed_loop()}}) {
    const std::vector<double> expected = moduli(a);
    std::vector<double> found;
    const nlohmann::json& listed = data["poles"][name][4];
    for (size_t i = 0; i < 6; i += 2) found.push_back(std::hypot(double(listed[i]), double(listed[i + 1])));
    std::sort(found.begin(), found.end());
    for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(found[i], expected[i], 1e-5 * expected[2]) << name;  // six digits
  }
}

TEST(ReportPage, StepsWithoutFiniteEigenvaluesAreLeftOutAndCounted) {
  Model system = random_system({3, 2, 2}, 30, 0.9, 17);
  for (Step& step : system.step) step.G() = Random(18).matrix(3, 2);
  const Ensemble data = random_experiments(system, 4, 18);
  const size_t wild = 10;
  system.step[wild].C() *= 1e6;
  system.step[wild].G().setConstant(1e306);  // what a file may hold, and G·C is infinite
  const std::string html = report_page(system, data).html;
  EXPECT_TRUE(contains(html, "not shown at one step: the eigenvalues of A or A + GC are not finite there"));
  const nlohmann::json poles = page_data(html)["poles"];
  EXPECT_GT(poles["k"].size(), 20u);
  for (const Index k : poles["k"]) EXPECT_NE(k, system.k_begin + Index(wild));
  for (const auto& step : poles["closed"])
    for (const auto& number : step) EXPECT_TRUE(number.is_number()) << number;
}

// Pulses against pulse_response(), and steps against the sum of the pulses so far, which is the definition of a linear
// system. Both are sums of the same products in another order: their errors are a few rounding errors of each term.
TEST(Responses, AreThoseOfTheModelAndStepsAddUpPulses) {
  std::uint64_t seed = 70;
  for (const auto& [n, r, m, period] :
       {std::tuple<Index, Index, Index, Index>{3, 2, 2, 0}, {5, 1, 3, 0}, {1, 3, 1, 0}, {4, 2, 2, 1}, {3, 1, 2, 6}}) {
    const Index steps = 30, length = 12;
    Model model = random_system({n, m, r}, steps, 0.9, ++seed);
    for (Index k = period; period > 0 && k < steps; ++k) model.step[size_t(k)] = model.step[size_t(k - period)];
    model.period = period;
    const std::vector<Index> starts{0, 7, steps - length};
    const report::Responses found = report::responses(model, starts, length);
    for (size_t s = 0; s < starts.size(); ++s) {
      for (Index k = 0; k < length; ++k) {
        Matrix expected_step = Matrix::Zero(m, r);
        double size = 0.0;
        for (Index i = 0; i <= k; ++i) {
          const Matrix h =
              i == k ? Matrix(model.at(starts[s] + k).D()) : pulse_response(model, starts[s] + k, starts[s] + i);
          expected_step += h;
          size += h.cwiseAbs().maxCoeff();
        }
        const double tolerance = 1e3 * std::numeric_limits<double>::epsilon() * double(n * length) * size;
        const Matrix expected_pulse =
            k == 0 ? Matrix(model.at(starts[s]).D()) : pulse_response(model, starts[s] + k, starts[s]);
        EXPECT_LE((found.pulse[s].row(k).reshaped(m, r) - expected_pulse).cwiseAbs().maxCoeff(), tolerance);
        EXPECT_LE((found.step[s].row(k).reshaped(m, r) - expected_step).cwiseAbs().maxCoeff(), tolerance);
      }
    }
    // A periodic model goes on, another one ends.
    const report::Responses beyond = report::responses(model, {steps - 2}, length);
    EXPECT_EQ(beyond.pulse.front().allFinite(), period > 0);
    EXPECT_TRUE(beyond.pulse.front().topRows(2).allFinite());
  }
}

TEST(Responses, StartWithinTheModelAndAreFewForManyChannels) {
  for (const Index steps : {1, 2, 9, 40, 500})
    for (const Index channels : {1, 4, 60}) {
      Model model = random_system({1, channels, channels}, steps, 0.5, 3);
      model.k_begin = 5;
      const Index length = report::response_length(model);
      const std::vector<Index> starts = report::response_starts(model);
      ASSERT_FALSE(starts.empty());
      EXPECT_GE(starts.front(), 5);
      EXPECT_LE(starts.back() + length, model.k_end());
      EXPECT_TRUE(std::is_sorted(starts.begin(), starts.end(), std::less_equal<>()));
      if (channels == 60 && length > 2) {
        EXPECT_EQ(starts.size(), 1u);
      }
    }
}

// Steps that the caller chooses, in order and each once. Later ones of a periodic model are like earlier ones.
TEST(Responses, StartAtTheChosenSteps) {
  Model model = random_system({2, 1, 2}, 40, 0.9, 3);
  model.k_begin = 5;
  EXPECT_EQ(report::response_starts(model, {44, 7, 20, 7}), (std::vector<Index>{7, 20, 44}));
  const report::Responses late = report::responses(model, {44}, 3);
  EXPECT_TRUE(late.pulse.front().row(0).allFinite() && late.pulse.front().row(1).array().isNaN().all());
  for (const Index wrong : {-1, 4, 45}) {
    try {
      report::response_starts(model, {20, wrong});
      ADD_FAILURE() << wrong;
    } catch (const std::invalid_argument& error) {
      EXPECT_TRUE(contains(error.what(), fmt::format("at: step {} found, 5 to 44 needed", wrong))) << error.what();
    }
  }
  std::vector<Index> many;
  for (Index k = 5; k < 30; ++k) many.push_back(k);
  EXPECT_THROW(report::response_starts(model, many), std::invalid_argument);
  many.pop_back();
  EXPECT_EQ(report::response_starts(model, many), many);
  const Model wide = random_system({2, 40, 40}, 40, 0.5, 3);
  EXPECT_THROW(report::response_starts(wide, {3, 4}), std::invalid_argument);
  EXPECT_EQ(report::response_starts(wide, {3}), (std::vector<Index>{3}));
  Model period = constant_system({3, 2, 2}, 12, 0.8, 6);
  period.period = 1;
  EXPECT_EQ(report::responses(period, {100}, 5).pulse, report::responses(period, {0}, 5).pulse);
  EXPECT_EQ(report::response_starts(period, {100}), (std::vector<Index>{100}));
}

TEST(Responses, OfFrozenStepsAreThoseThatWereAsked) {
  const Model model = constant_system({3, 2, 2}, 40, 0.8, 6);
  const std::optional<Modes> modes = report::modes_of_page(model);
  ASSERT_TRUE(modes);
  const report::FrozenResponses found = report::frozen_responses(model, *modes, {0, 20, 25});
  EXPECT_EQ(found.steps, (std::vector<Index>{20, 25}));
  EXPECT_EQ(found.left_out, (std::vector<Index>{0}));  // no window of outputs lies around it
  // Another model at the same steps and frequencies, which need not be its own ones.
  const Model other = constant_system({3, 2, 2}, 60, 0.7, 7);
  const auto theirs = report::frozen_responses_of(other, report::modes_of_page(other), found, model.dt);
  ASSERT_EQ(theirs.size(), 2u);
  const auto expected = frequency_response(other.at(20), model.dt, found.frequencies);
  // The frozen system of a constant one is that system in coordinates of its outputs. Its rounding errors grow by the
  // condition of a window of outputs, below 1e4 here.
  for (size_t i = 0; i < expected.size(); ++i)
    EXPECT_LE((theirs[0][i] - expected[i]).cwiseAbs().maxCoeff(), 1e-11 * expected[i].cwiseAbs().maxCoeff());
  const Model brief = constant_system({3, 2, 2}, 22, 0.7, 7);
  EXPECT_TRUE(report::frozen_responses_of(brief, report::modes_of_page(brief), found, model.dt)[1].empty());
}

TEST(Responses, PhasesHaveNoJumps) {
  std::vector<Eigen::MatrixXcd> response;
  for (int i = 0; i < 200; ++i) response.push_back(Eigen::MatrixXcd::Constant(1, 1, std::polar(2.0, -0.1 * double(i))));
  const report::FrozenCurves found = report::frozen_curves({response, {}});
  for (Index i = 0; i < 200; ++i) {
    EXPECT_NEAR(found.magnitude[0](i, 0), 2.0, 1e-15 * 2);
    EXPECT_NEAR(found.phase[0](i, 0), -0.1 * double(i), 4e-15 * 20);  // some rounding errors of 20 radian
  }
  EXPECT_EQ(found.magnitude[1].size(), 0);
}

TEST(ReportPage, RefusesBandsAndModelsOfAnotherSystem) {
  const Model model = oscillator(20);
  ReportOptions options;
  options.bands = ResponseBands{};
  EXPECT_THROW(report_page(model, noisy(5, 14, 20), options), std::invalid_argument);
  options.bands.reset();
  options.compare = {{"other", random_system({2, 1, 2}, 20, 0.5, 3)}};
  try {
    report_page(model, noisy(5, 14, 20), options);
    ADD_FAILURE() << "taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_TRUE(contains(error.what(), "other")) << error.what();
  }
}

// Bands without width about the responses of a model.
ResponseBands bands_of(const Model& model, const std::vector<Index>& at = {}) {
  ResponseBands bands;
  bands.starts = report::response_starts(model, at);
  bands.length = report::response_length(model);
  report::Responses own = report::responses(model, bands.starts, bands.length);
  bands.pulse = bands.pulse_lower = bands.pulse_upper = std::move(own.pulse);
  bands.step = bands.step_lower = bands.step_upper = std::move(own.step);
  if (const std::optional<Modes> modes = report::modes_of_page(model)) {
    const report::FrozenResponses frozen = report::frozen_responses(model, *modes, at);
    report::FrozenCurves curves = report::frozen_curves(frozen.response);
    bands.frozen_steps = frozen.steps;
    bands.frequencies = frozen.frequencies;
    bands.magnitude = bands.magnitude_lower = bands.magnitude_upper = std::move(curves.magnitude);
    bands.phase = bands.phase_lower = bands.phase_upper = std::move(curves.phase);
  }
  bands.findings = {{.kind = Finding::Kind::reader_remark, .detail = "found by the bootstrap"}};
  return bands;
}

TEST(ReportPage, RefusesBandsOfAnotherModelOfTheSameSize) {
  const Model model = oscillator(20);
  const Ensemble data = noisy(5, 14, 20);
  ReportOptions options;
  Random random(3);
  Model turned = model;  // the same system in other coordinates
  Matrix before = Matrix::Identity(turned.n(0), turned.n(0));
  for (Step& step : turned.step) {
    const Matrix next = Matrix::Identity(4, 4) + 0.2 * random.matrix(4, 4);
    const Matrix back = linalg::solve(before, Matrix(Matrix::Identity(4, 4)));
    step = Step(Matrix(next * step.A() * back), Matrix(next * step.B()), Matrix(step.C() * back), Matrix(step.D()),
                Matrix(next * step.G()));
    before = next;
  }
  for (const Model* same : {&model, &std::as_const(turned)}) {
    options.bands = bands_of(*same);
    const std::string html = report_page(model, data, options).html;
    EXPECT_FALSE(page_data(html)["responses"]["bands"].is_null());
    const std::string text = "found by the bootstrap</li>";
    EXPECT_TRUE(contains(html, text));
    EXPECT_EQ(html.find(text), html.rfind(text));  // once
  }
  for (const double change : {1e-3, 1.0}) {
    Model other = model;
    for (Step& step : other.step) step.B() *= 1 + change;
    options.bands = bands_of(other);
    EXPECT_THROW(report_page(model, data, options), std::invalid_argument);
  }
}

TEST(ReportPage, RefusesBandsOfOtherFrozenResponses) {
  const Model model = constant_system({3, 2, 2}, 40, 0.8, 6);
  const Ensemble data = random_experiments(model, 5, 7);
  ReportOptions options;
  options.bands = bands_of(model);
  const nlohmann::json bands = page_data(report_page(model, data, options).html)["frozen"]["bands"];
  ASSERT_FALSE(bands.is_null());
  const auto refused = [&] {
    EXPECT_THROW(report_page(model, data, options), std::invalid_argument);
    options.bands = bands_of(model);
  };
  ASSERT_FALSE(options.bands->magnitude.empty());
  options.bands->magnitude[0] *= 1.001;
  refused();
  options.bands->phase[0].array() += 0.001;
  refused();
  options.bands->frequencies *= 1.001;
  refused();
  options.bands->phase_lower.pop_back();
  refused();
  options.bands->frozen_steps.back() += 1;
  refused();
  // Bands at other steps than the page
  options.at = {0, 20};
  EXPECT_THROW(report_page(model, data, options), std::invalid_argument);
  options.bands = bands_of(model, options.at);
  const nlohmann::json found = page_data(report_page(model, data, options).html);
  EXPECT_EQ(found["responses"]["starts"], nlohmann::json({0, 20}));
  EXPECT_EQ(found["frozen"]["steps"], nlohmann::json({20}));
  // The phase of a response of zero is arbitrary.
  Model silent = model;
  for (Step& step : silent.step) step.C().row(1).setZero(), step.D().row(1).setZero();
  options = {};
  options.bands = bands_of(silent);
  for (Matrix& phase : options.bands->phase)
    for (const Index column : {1, 3}) phase.col(column).array() += 1.0;
  EXPECT_NO_THROW(report_page(silent, random_experiments(silent, 5, 7), options));
}

// A model that overflows has no fit, and takes no samples from the others.
TEST(ReportPage, ComparesModelsWithOneThatOverflows) {
  const Model model = oscillator(40);
  const Ensemble data = noisy(8, 50);
  report::Tested tested = report::tested(model, data, {});
  tested.options.compare = {{"itself", model}};
  const report::ModelComparison alone = report::compare_models(model, data, tested);
  for (const double growth : {1e10, 1e40, 1e200}) {
    Model wild = model;
    for (Step& step : wild.step) step.A() *= growth;
    tested.options.compare = {{"itself", model}, {"wild", wild}};
    const report::ModelComparison found = report::compare_models(model, data, tested);
    EXPECT_EQ(found.from, alone.from);
    for (const auto kind :
         {&report::ComparedModel::simulation, &report::ComparedModel::one_step, &report::ComparedModel::ahead})
      for (size_t i = 0; i < 2; ++i) {
        EXPECT_EQ((found.models[i].*kind).fit, (alone.models[i].*kind).fit);
        EXPECT_EQ((found.models[i].*kind).samples, (alone.models[i].*kind).samples);
      }
    EXPECT_EQ(found.models[2].simulation.samples, alone.models[0].simulation.samples);
    for (const double fit : found.models[2].simulation.fit) EXPECT_LT(fit, -1e9) << growth;
    const std::string html = report_page(model, data, tested.options).html;
    EXPECT_TRUE(contains(html, "best simulation"));
  }
}

// A model that begins too late to estimate its initial states simulates nothing. The others are compared without it.
TEST(ReportPage, ComparesModelsWithOneThatSimulatesNothing) {
  const Model model = oscillator(40);
  Ensemble data = noisy(8, 50);
  Model late = from_step(model, 39);
  late.initial_state = InitialState::unknown;
  report::Tested tested = report::tested(model, data, {});
  tested.options.compare = {{"itself", model}};
  const report::ModelComparison alone = report::compare_models(model, data, tested);
  tested.options.compare = {{"itself", model}, {"too late", late}};
  const report::ModelComparison found = report::compare_models(model, data, tested);
  EXPECT_EQ(found.models[2].simulation.samples, 0);
  EXPECT_GT(found.models[0].simulation.samples, 0);
  EXPECT_EQ(found.models[0].simulation.fit, found.models[1].simulation.fit);
  EXPECT_LT(found.from, 40);
  const std::string html = report_page(model, data, tested.options).html;
  EXPECT_TRUE(contains(html, "Not every output is simulated by too late."));
}

TEST(ReportPage, ComparesModelsOnThePageOfAnIdentification) {
  const Ensemble data = noisy(40, 3);
  for (const double hold_out : {0.0, 0.25}) {
    const IdentifyOptions identified{.states = 4, .lags = 4, .method = Method::tvera, .hold_out = hold_out};
    const Identification result = identify(data, identified);
    ReportOptions options;
    options.compare = {{"truth", oscillator(40)}};
    const nlohmann::json found = page_data(identification_page(result, data, identified, options).html);
    EXPECT_EQ(found["models"], nlohmann::json({"this model", "truth"}));
    EXPECT_EQ(found["responses"]["others"].size(), 1u);
    for (const auto& experiment : found["traces"]["experiments"]) EXPECT_EQ(experiment["others"].size(), 1u);
  }
}

TEST(ReportPage, StatesWhatEachModelHasSeen) {
  using report::Known;
  const Ensemble data = noisy(60, 3), fresh = noisy(60, 4);
  const auto identified = [](const Ensemble& from, double hold_out) {
    return identify(from, {.states = 4, .lags = 4, .method = Method::tvera, .hold_out = hold_out}).model;
  };
  const Model model = identified(data, 0.25);
  report::Tested tested = report::tested(model, data, {});
  const std::vector<double> shares{0.25, 0.1, 0.4, 0.5};
  for (const double share : shares) tested.options.compare.push_back({"other", identified(data, share)});
  tested.options.compare.push_back({"all", identified(data, 0.0)});
  tested.options.compare.push_back({"fresh", identified(fresh, 0.25)});
  const report::ModelComparison found = report::compare_models(model, data, tested);
  EXPECT_EQ(found.models[0].known, Known::held_out);
  Index partly = 0;
  for (size_t i = 0; i < shares.size(); ++i) {
    std::vector<Index> rows = split(data, shares[i]).held_out_rows, both;
    std::set_intersection(rows.begin(), rows.end(), tested.rows.begin(), tested.rows.end(), std::back_inserter(both));
    const Known expected = both.size() == tested.rows.size() ? Known::held_out
                           : both.empty()                    ? Known::training
                                                             : Known::partly;
    EXPECT_EQ(found.models[i + 1].known, expected) << shares[i];
    partly += expected == Known::partly;
  }
  EXPECT_GT(partly, 0);
  EXPECT_EQ(found.models[1].known, Known::held_out);
  EXPECT_EQ(found.models[5].known, Known::training);
  EXPECT_EQ(found.models[6].known, Known::not_seen);
  // What the caller states of the model of the page holds.
  ReportOptions stated;
  stated.evaluation = Evaluation::training;
  stated.compare = {{"fresh", identified(fresh, 0.25)}};
  const report::Tested told = report::tested(oscillator(40), data, stated);
  EXPECT_EQ(report::compare_models(oscillator(40), data, told).models[0].known, Known::training);
}

TEST(ReportPage, ShowsStepsWithoutAStatedSampleTime) {
  Model model = constant_system({3, 2, 2}, 40, 0.9, 6);
  for (Step& step : model.step) step.set_condition(10.0);
  Ensemble data = random_experiments(model, 6, 7);
  for (const bool stated : {true, false}) {
    model.provenance.dt_stated = data.dt_stated = stated;
    const std::string html = report_page(model, data).html;
    EXPECT_EQ(contains(html, "Time [s]</th>"), stated);
    EXPECT_EQ(contains(html, "no sample time stated"), !stated);
    EXPECT_EQ(page_data(html)["frozen"]["timed"], stated);
  }
}

TEST(ReportPage, BoundsTheModelsOfAComparison) {
  const Model model = random_system({2, 20, 20}, 60, 0.5, 12);
  const Ensemble data = random_experiments(model, 4, 13);
  ReportOptions options;
  for (int i = 0; i < 30; ++i) options.compare.push_back({fmt::format("model {}", i), model});
  const std::string html = report_page(model, data, options).html;
  EXPECT_LT(html.size(), 6'000'000u);
  EXPECT_EQ(page_data(html)["responses"]["others"].size(), 8u);
  EXPECT_TRUE(contains(html, "The plots show 8 of 30 compared models; the tables have all."));
  EXPECT_TRUE(contains(html, "The table shows 19 of 20 outputs."));
  EXPECT_TRUE(contains(html, "The table shows 12 of 20 inputs."));
}

// A model beside itself has its own fits, wherever the other one begins.
TEST(ReportPage, ComparesModelsOverTheSameSamples) {
  const Model model = oscillator(40), late = from_step(model, 9);
  const Ensemble data = noisy(8, 50);
  report::Tested tested = report::tested(model, data, {});
  tested.options.compare = {{"itself", model}, {"late", late}};
  const report::ModelComparison found = report::compare_models(model, data, tested);
  ASSERT_EQ(found.models.size(), 3u);
  EXPECT_GE(found.from, 9);
  for (const auto kind :
       {&report::ComparedModel::simulation, &report::ComparedModel::one_step, &report::ComparedModel::ahead}) {
    const Fit own = found.models[0].*kind, same = found.models[1].*kind, other = found.models[2].*kind;
    EXPECT_EQ(own.fit, same.fit);
    EXPECT_EQ(own.samples, other.samples);
    EXPECT_LE(own.samples, data.experiments() * (data.steps() - found.from));
    EXPECT_GT(own.samples, 0);
  }
  tested.options.compare.clear();
  EXPECT_TRUE(report::compare_models(model, data, tested).models.empty());
}

TEST(ReportPage, TakesModelsOfEveryKind) {
  // States that come and go, one step, one experiment, no states.
  ExperimentOptions options;
  options.experiments = 20;
  const Ensemble data = experiments(oscillator(30), options);
  const Model identified = identify(data).model;
  Model stateless = random_system({1, 1, 1}, 5, 0.5, 19);
  for (Step& step : stateless.step)
    step = Step(Matrix(0, 0), Matrix(0, 1), Matrix(1, 0), Matrix(step.D()), Matrix(0, 1));
  const Model one_step = random_system({2, 1, 1}, 1, 0.5, 20);
  const Case cases[] = {{identified, data.subset({0})},
                        {from_step(identified, 12), data},
                        {smooth_frame(identified, 3), data},
                        {stateless, random_experiments(stateless, 4, 21)},
                        {one_step, random_experiments(one_step, 1, 22)}};
  for (const auto& [model, ensemble] : cases) {
    const ReportPage page = report_page(model, ensemble);
    EXPECT_FALSE(page.verdict.summary.empty());
    EXPECT_TRUE(page_data(page.html).contains("poles"));
  }
}

TEST(ReportPage, RefusesOtherChannels) {
  EXPECT_THROW(report_page(oscillator(20), Ensemble(3, 20, 1, 2)), std::invalid_argument);
  EXPECT_THROW(report_page(from_step(oscillator(20), 15), noisy(3, 23, 10)), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
