// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/step.hpp"

#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "model/step_fields.hpp"
#include "testing.hpp"
#include "tokid/parallel.hpp"

namespace tokid::testing {
namespace {

// What the step has to hold, as matrices of their own.
struct Kept {
  std::array<std::optional<Matrix>, step_fields::all.size()> matrices;
  std::optional<Vector> singular_values;
  std::optional<double> condition;
  std::optional<Index> rank, lags;
};

void expect_kept(const Step& step, const Kept& kept) {
  for (size_t i = 0; i < kept.matrices.size(); ++i) {
    const StepField& field = step_fields::all[i];
    ASSERT_EQ(field.known(step), kept.matrices[i].has_value()) << field.name;
    if (kept.matrices[i]) {
      EXPECT_EQ(Matrix((step.*field.view)()), *kept.matrices[i]) << field.name;
    }
  }
  ASSERT_EQ(step.has_singular_values(), kept.singular_values.has_value());
  if (kept.singular_values) {
    EXPECT_EQ(Vector(step.singular_values()), *kept.singular_values);
  }
  ASSERT_EQ(step.has_condition(), kept.condition.has_value());
  if (kept.condition) {
    EXPECT_EQ(step.condition(), *kept.condition);
  }
  ASSERT_EQ(step.has_rank(), kept.rank.has_value());
  if (kept.rank) {
    EXPECT_EQ(step.rank(), *kept.rank);
  }
  ASSERT_EQ(step.has_lags(), kept.lags.has_value());
  if (kept.lags) {
    EXPECT_EQ(step.lags(), *kept.lags);
  }
}

// What the other step has replaces one's own, what it lacks is left; matrices and noise stay.
TEST(Step, TakesDiagnosticsOfAnother) {
  Random random(17);
  for (int own = 0; own < 32; ++own)
    for (int other = 0; other < 32; ++other) {
      const auto step = [&random](Index n, int known, Kept& kept) {
        Step made(random.matrix(n, n), random.matrix(n, 1), random.matrix(2, n), random.matrix(2, 1),
                  random.matrix(n, 2));
        for (size_t i = 0; i < 5; ++i) kept.matrices[i] = Matrix((made.*step_fields::all[i].view)());
        if (known & 1) made.set_innovation_cov(*(kept.matrices[5] = random.matrix(2, 2)));
        if (known & 2) made.set_singular_values(*(kept.singular_values = random.matrix(1 + Index(known), 1)));
        if (known & 4) made.set_condition(*(kept.condition = random.normal()));
        if (known & 8) made.set_rank(*(kept.rank = Index(random.uniform(0, 50))));
        if (known & 16) made.set_lags(*(kept.lags = Index(random.uniform(0, 50))));
        return made;
      };
      Kept kept, theirs;
      Step taker = step(3, own, kept);
      taker.set_R(*(kept.matrices[7] = random.matrix(2, 2)));
      const Step giver = step(4, other, theirs);
      taker.take_diagnostics_of(giver);
      if (theirs.matrices[5]) kept.matrices[5] = theirs.matrices[5];
      if (theirs.singular_values) kept.singular_values = theirs.singular_values;
      if (theirs.condition) kept.condition = theirs.condition;
      if (theirs.rank) kept.rank = theirs.rank;
      if (theirs.lags) kept.lags = theirs.lags;
      expect_kept(taker, kept);
      expect_kept(giver, theirs);
    }
}

TEST(Step, HoldsWhatItWasGivenInWhateverOrder) {
  for (const auto& [n, next, r, m] :
       {std::array<Index, 4>{2, 2, 1, 1}, {3, 4, 2, 3}, {0, 3, 2, 1}, {3, 0, 1, 2}, {0, 0, 1, 1}, {4, 4, 0, 2}}) {
    Random random(std::uint64_t(1 + 1000 * n + 100 * next + 10 * r + m));
    Step step(n, next, r, m);
    Kept kept;
    for (size_t i = 0; i < kept.matrices.size(); ++i)
      if (const StepField& field = step_fields::all[i]; !field.optional)
        kept.matrices[i] = Matrix::Zero(size(step, field.rows), size(step, field.cols));
    expect_kept(step, kept);
    for (int change = 0; change < 200; ++change) {
      const auto part = size_t(random.uniform(0, 16));
      if (part < kept.matrices.size()) {
        const StepField& field = step_fields::all[part];
        kept.matrices[part] = random.matrix(size(step, field.rows), size(step, field.cols));
        field.set(step, *kept.matrices[part]);
      } else if (part == 9) {
        kept.singular_values = random.matrix(Index(random.uniform(0, 6)), 1);
        step.set_singular_values(*kept.singular_values);
      } else if (part == 10) {
        step.set_condition(*(kept.condition = random.normal()));
      } else if (part == 11) {
        step.set_rank(*(kept.rank = Index(random.uniform(0, 1e6))));
      } else if (part == 12) {
        step.set_lags(*(kept.lags = Index(random.uniform(0, 50))));
      } else if (part == 13) {
        step.forget_innovation_cov();
        kept.matrices[5].reset();
      } else if (part == 14) {
        step.forget_noise();
        for (const size_t i : {6, 7, 8}) kept.matrices[i].reset();
      } else {
        const Step copy = step;
        EXPECT_EQ(copy, step);
        step = Step(n, next, r, m);
        EXPECT_EQ(copy.A().rows(), next);
        step = copy;
      }
      expect_kept(step, kept);
    }
    const Step outline = step.outline();
    EXPECT_EQ(outline.states(), n);
    EXPECT_EQ(outline.next_states(), next);
    EXPECT_EQ(outline.has_rank(), step.has_rank());
    if (step.has_rank()) {
      EXPECT_EQ(outline.rank(), step.rank());
    }
    if (step.has_lags()) {
      EXPECT_EQ(outline.lags(), step.lags());
    }
    if (step.has_condition()) {
      EXPECT_EQ(outline.condition(), step.condition());
    }
    EXPECT_FALSE(outline.has_innovation_cov() || outline.has_Q() || outline.has_singular_values());
  }
}

TEST(Step, OfMatrices) {
  Random random(3);
  const Matrix a = random.matrix(3, 2), b = random.matrix(3, 1), c = random.matrix(2, 2), d = random.matrix(2, 1),
               g = random.matrix(3, 2);
  const Step step(a, b, c, d, g);
  EXPECT_EQ(step.states(), 2);
  EXPECT_EQ(step.next_states(), 3);
  EXPECT_EQ(Matrix(step.A()), a);
  EXPECT_EQ(Matrix(step.G()), g);
  EXPECT_EQ(step.closed_loop(), a + g * c);
  EXPECT_EQ(message([&] { Step(a, c, c, d, g); }), "step: B is 2 x 2, 3 x 2 needed");
  EXPECT_EQ(message([&] { Step(a, b, d, d, g); }), "step: C is 2 x 1, 2 x 2 needed");
  EXPECT_EQ(message([&] { Step(a, b, c, b, g); }), "step: D is 3 x 1, 2 x 1 needed");
  EXPECT_EQ(message([&] { Step(a, b, c, d, b); }), "step: G is 3 x 1, 3 x 2 needed");
  EXPECT_EQ(message([&] { Step(-1, 2, 1, 1); }), "step: a dimension of -1 found, 0 or more needed");
  Step other = step;
  EXPECT_EQ(message([&] { other.A() = d; }), "step: a matrix of 2 x 1 found, 3 x 2 needed");
  EXPECT_EQ(message([&] { other.A() = other.C(); }), "step: a matrix of 2 x 2 found, 3 x 2 needed");
  EXPECT_EQ(message([&] { other.set_Q(c); }), "step: Q is 2 x 2, 3 x 3 needed");
  EXPECT_EQ(message([&] { other.set_K(g); }), "step: K is 3 x 2, 2 x 2 needed");
  EXPECT_THROW(other.Q(), std::logic_error);
  EXPECT_THROW(other.rank(), std::logic_error);
  EXPECT_THROW(other.outline().A(), std::logic_error);
  EXPECT_EQ(other.singular_values().size(), 0);
  EXPECT_EQ(other, step);  // a refused call changes nothing
}

// Millions of steps are held at once.
// Copies have the numbers in one place until one of them is written to, whatever is written and in whichever of them.
TEST(Step, SharesNumbersUntilTheyDiffer) {
  Random random(19);
  const auto place = [](const Step& step) { return step.A().data(); };
  const Step first(random.matrix(3, 3), random.matrix(3, 1), random.matrix(2, 3), random.matrix(2, 1),
                   random.matrix(3, 2));
  const std::vector<std::function<void(Step&)>> writers = {
      [](Step& s) { s.A()(0, 0) += 1; }, [](Step& s) { s.G().setZero(); }, [](Step& s) { s.set_Q(Matrix::Ones(3, 3)); },
      [](Step& s) { s.set_lags(4); }, [](Step& s) { s.set_singular_values(Vector::Ones(2)); }};
  for (size_t i = 0; i < writers.size(); ++i)
    for (const bool write_copy : {false, true}) {
      SCOPED_TRACE(i);
      Step original = first;
      Step copy = original;
      EXPECT_EQ(place(original), place(first));
      EXPECT_EQ(place(copy), place(first));
      Step &written = write_copy ? copy : original, &other = write_copy ? original : copy;
      writers[i](written);
      EXPECT_NE(place(written), place(first));
      EXPECT_EQ(place(other), place(first));
      EXPECT_FALSE(written == first);
      EXPECT_TRUE(other == first);
      const double* own = place(written);
      written.A()(1, 1) = 5;  // the only owner writes in place
      EXPECT_EQ(place(written), own);
    }
}

// Threads that write to copies of one step do not see each other.
TEST(Step, CopiesAreIndependentOfThreads) {
  constexpr Index count = 200;
  for (int round = 0; round < 20; ++round) {
    std::vector<Step> steps(size_t(count), Step(2, 2, 1, 1));
    parallel_for(0, count, {4, {}}, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        steps[size_t(k)].A().setConstant(double(k));
        steps[size_t(k)].set_lags(k);
      }
    });
    for (Index k = 0; k < count; ++k) {
      const Step& step = steps[size_t(k)];
      EXPECT_EQ(Matrix(step.A()), Matrix::Constant(2, 2, double(k)));
      EXPECT_EQ(step.lags(), k);
      EXPECT_EQ(Matrix(step.B()), Matrix::Zero(2, 1));
    }
  }
}

TEST(Step, IsSmall) { EXPECT_LE(sizeof(Step), 48u); }

}  // namespace
}  // namespace tokid::testing
