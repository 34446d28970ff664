// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/finding.hpp"

#include <gtest/gtest.h>

#include <set>

#include "testing.hpp"
#include "tokid/conclusion.hpp"

namespace tokid {
namespace {

using Kind = Finding::Kind;

const Finding::Channel u1{false, 0, "u1"}, u2{false, 1, "valve"}, y1{true, 0, "y1"};

std::vector<Kind> kinds() {
  std::vector<Kind> result;
  for (int k = 0; k <= int(Kind::last); ++k) result.push_back(Kind(k));
  return result;
}

// Every kind has a name of its own, in lower case, by which programs know it.
TEST(Finding, KindsHaveNames) {
  std::set<std::string> names;
  for (const Kind kind : kinds()) {
    const std::string name = to_string(kind);
    EXPECT_TRUE(names.insert(name).second) << name;
    EXPECT_EQ(name.find_first_not_of("abcdefghijklmnopqrstuvwxyz_"), std::string::npos) << name;
  }
  EXPECT_STREQ(to_string(Kind::reader_remark), "reader_remark");
  EXPECT_STREQ(to_string(Kind::samples_outlying), "samples_outlying");
  EXPECT_STREQ(to_string(Kind::plan_ill_conditioned), "plan_ill_conditioned");
}

// With every field that a kind may have, its sentence lacks none.
TEST(Finding, SentencesAreComplete) {
  Finding all{.channels = {u1, u2},
              .experiments = {{3}, {4, "run 5"}},
              .steps = {6, 7},
              .terms = {{u1, 0, 1.0}, {y1, 2, -0.5}},
              .groups = {{{1}}, {{1}, {2}}},
              .names = {"a", "b"},
              .detail = "words"};
  for (const char* name :
       {"agreement", "asked",        "begin",   "bias",   "bound",        "condition",   "constant",   "count",
        "courses",   "data",         "dt",      "end",    "error",        "experiments", "failed",     "first",
        "fit",       "found",        "gain",    "gaps",   "horizon",      "inputs",      "iterations", "sampled",
        "lags",      "largest_lags", "last",    "length", "lags_outputs", "model",       "most",       "needed",
        "outputs",   "period",       "rank",    "ratio",  "recommended",  "regressors",  "replicates", "share",
        "smoothing", "stated",       "states",  "step",   "steps",        "sufficient",  "unknowns",   "usual",
        "turn",      "value",        "varying", "wanted", "windows",      "held_out",    "weight"})
    all.numbers[name] = 2.0;
  for (const Kind kind : kinds()) {
    all.kind = kind;
    const std::string text = in_words(all);
    EXPECT_GT(text.size(), 4u) << to_string(kind);
    EXPECT_EQ(text.find("nan"), std::string::npos) << text;
    EXPECT_EQ(text.find("-9223372036854775808"), std::string::npos) << text;
  }
}

// With every field that a reason may have, its sentence lacks none.
TEST(Conclusion, SentencesAreComplete) {
  Conclusion all{
      .result = TestResult::negligible,
      .numbers = {{"correlation", 0.1}, {"interval", 0.2}, {"lag", 1}, {"limit", 0.2}, {"p", 0.003}, {"ratio", 1.5}},
      .channels = {u1, u2},
      .errors = {-0.5, 0.25},
      .intervals = {0.1, 0.2},
      .pooled = true};
  std::set<std::string> names, sentences;
  for (int reason = 0; reason <= int(Conclusion::Reason::last); ++reason) {
    all.reason = Conclusion::Reason(reason);
    EXPECT_TRUE(names.insert(to_string(all.reason)).second) << to_string(all.reason);
    EXPECT_TRUE(sentences.insert(in_words(all)).second) << in_words(all);
  }
  all.reason = Conclusion::Reason::correlated;
  EXPECT_EQ(in_words(all),
            "p = 0.003: the innovations are correlated in time, up to 0.1 at lag 1, too small to matter (less than "
            "0.2); tested over all steps together, because there are few experiments");
  all.reason = Conclusion::Reason::gains_wrong;
  EXPECT_EQ(in_words(all),
            "the outputs respond to u1 50 % less than the model says (± 10 %), to valve 25 % more than the model says "
            "(± 20 %); too small to matter");
}

TEST(Finding, SumsAreWrittenWithTheFirstChannelAlone) {
  Finding found{.kind = Kind::outputs_dependent, .channels = {u1, y1}, .numbers = {{"constant", 0.0}}};
  found.terms = {{u1, 0, 2.0}, {y1, 0, -4.0}};
  EXPECT_EQ(testing::mentions({in_words(found)}, "(u1 - 2 y1 is zero)"), 1);
  found.terms = {{u1, 0, -1.0}, {u2, 0, -1.0}, {y1, 0, 0.25}};
  found.numbers["constant"] = 1.0;
  EXPECT_EQ(testing::mentions({in_words(found)}, "(u1 + valve - 0.25 y1 is constant)"), 1);
}

TEST(Finding, SamplesOfLongSumsAreNamedByTheirLags) {
  Finding found{.kind = Kind::input_feedback,
                .channels = {u1},
                .steps = {9},
                .numbers = {{"constant", 0.0}, {"varying", 0.0}, {"period", 0.0}}};
  for (const Index lag : {0, 1, 2, 3, 6}) found.terms.push_back({u1, lag, 1.0});
  found.terms.push_back({y1, 2, 1.0});
  found.terms.push_back({y1, 1, 1.0});
  EXPECT_EQ(testing::mentions({in_words(found)}, "u1(k), u1(k-1…3, 6) and y1(k-1, 2)"), 1);
}

// What findings are about stands in front of them.
TEST(Finding, ScopesAndFiles) {
  Finding found{.kind = Kind::output_constant, .channels = {y1}};
  const std::string plain = in_words(found);
  EXPECT_EQ(plain, "output y1 is constant: nothing about this output can be identified");
  found.file = "run.csv";
  EXPECT_EQ(in_words(found), "run.csv: " + plain);
  found.file.clear();
  found.scope = Finding::Scope::first_steps;
  EXPECT_EQ(in_words(found), "in the first steps, on which tokid made its choices, " + plain);
  found.scope = Finding::Scope::folds;
  found.numbers = {{"folds", 5.0}, {"folds_with", 2.0}};
  EXPECT_EQ(in_words(found), "cross-validation, 2 of 5 folds: " + plain);
}

}  // namespace
}  // namespace tokid
