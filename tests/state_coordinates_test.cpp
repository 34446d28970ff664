// SPDX-License-Identifier: BSD-3-Clause
#include "noise/em/state_coordinates.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/observer.hpp"

namespace tokid {
namespace {

using testing::epsilon;
using testing::Random;
using testing::SystemSize;

constexpr Index steps = 40;

// Its matrices vary slowly.
Model slow_system(const SystemSize& size, std::uint64_t seed) {
  Model model = testing::constant_system(size, steps, 0.9, seed);
  const Model last = testing::constant_system(size, steps, 0.9, seed + 1);
  for (Index k = 0; k < steps; ++k) {
    const double share = 0.1 * double(k) / double(steps);
    Step& step = model.step[size_t(k)];
    const Step& end = last.step[size_t(k)];
    step.A() = step.A() + share * (end.A() - step.A());
    step.B() = step.B() + share * (end.B() - step.B());
    step.C() = step.C() + share * (end.C() - step.C());
    step.D() = step.D() + share * (end.D() - step.D());
  }
  return model;
}

// The same system in coordinates that differ from step to step.
Model in_rough_coordinates(const Model& model, Random& random) {
  const Index n = model.states();
  std::vector<Matrix> s;
  for (Index k = 0; k <= model.steps(); ++k) s.push_back(Matrix::Identity(n, n) + 0.05 * random.matrix(n, n));
  return transform(model, s);
}

em::Variation unweighted(const SystemSize& size) {
  return {Matrix::Identity(size.n, size.n), Matrix::Identity(size.m, size.m), Vector::Ones(size.n + size.r),
          Vector::Ones(size.n + size.r)};
}

em::Variation weighted(const SystemSize& size, Random& random) {
  const auto covariance = [&](Index n) {
    const Matrix root = random.matrix(n, n);
    return Matrix(Matrix::Identity(n, n) + root * root.transpose());
  };
  const auto weight = [&] { return Vector(random.matrix(size.n + size.r, 1).array().square() + 0.5); };
  em::Variation variation{covariance(size.n), covariance(size.m), {}, {}};
  variation.process_weight = weight();
  variation.measurement_weight = weight();
  return variation;
}

struct Matrices {
  linalg::MatrixList ab, cd;
};
Matrices matrices_of(const Model& model) {
  const Index n = model.states(), l = n + model.inputs;
  Matrices result{{model.steps(), n, l}, {model.steps(), model.outputs, l}};
  for (size_t k = 0; k < size_t(model.steps()); ++k) {
    result.ab[k] = linalg::beside(model.step[k].A(), model.step[k].B());
    result.cd[k] = linalg::beside(model.step[k].C(), model.step[k].D());
  }
  return result;
}

TEST(StateCoordinates, RoughOnesBecomeNearlyAsSmoothAsTheSystem) {
  for (const SystemSize& size : {SystemSize{1, 1, 1}, {2, 1, 2}, {4, 2, 2}, {7, 3, 1}, {3, 2, 0}})
    for (const std::uint64_t seed : {1, 2, 3}) {
      SCOPED_TRACE(testing::name(size) + " " + std::to_string(seed));
      Random random(seed);
      const Model smooth = slow_system(size, seed);
      const Matrices own = matrices_of(smooth), rough = matrices_of(in_rough_coordinates(smooth, random));
      const em::Variation variation = seed == 1 ? unweighted(size) : weighted(size, random);
      const auto found = em::with_less_variation(rough.ab, rough.cd, variation);
      ASSERT_TRUE(found);
      // The steps end before slow changes of the coordinates have gone.
      EXPECT_LT(variation.of(found->ab, found->cd), 0.05 * variation.of(rough.ab, rough.cd));
      EXPECT_GT(variation.of(rough.ab, rough.cd), 20 * variation.of(own.ab, own.cd));
    }
}

TEST(StateCoordinates, AreThoseThatTheyState) {
  const SystemSize size{3, 2, 2};
  Random random(4);
  const Model rough = in_rough_coordinates(slow_system(size, 5), random);
  const Matrices before = matrices_of(rough);
  for (const std::vector<Index>& jumps : {std::vector<Index>{}, {7, 20}}) {
    em::Variation variation = weighted(size, random);
    variation.jumps = jumps;
    const auto found = em::with_less_variation(before.ab, before.cd, variation);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->s[0], Matrix::Identity(size.n, size.n));
    const Matrices expected = matrices_of(transform(rough, found->s));
    // Products with S_k and their inverses.
    const double tolerance = 1000 * epsilon;
    EXPECT_LE((found->ab.together() - expected.ab.together()).norm(), tolerance * expected.ab.together().norm());
    EXPECT_LE((found->cd.together() - expected.cd.together()).norm(), tolerance * expected.cd.together().norm());
  }
}

TEST(StateCoordinates, ChangesAtJumpsDoNotCount) {
  const SystemSize size{2, 1, 1};
  Random random(6);
  const Matrices all = matrices_of(in_rough_coordinates(slow_system(size, 7), random));
  em::Variation variation = unweighted(size);
  const double whole = variation.of(all.ab, all.cd);
  variation.jumps = {9};
  const double change = (all.ab[9] - all.ab[8]).squaredNorm() + (all.cd[9] - all.cd[8]).squaredNorm();
  EXPECT_NEAR(variation.of(all.ab, all.cd), whole - change / 2, 100 * epsilon * whole);
}

TEST(StateCoordinates, AConstantSystemKeepsItsOwn) {
  const SystemSize size{3, 1, 1};
  const Matrices same = matrices_of(testing::constant_system(size, steps, 0.9, 8));
  EXPECT_FALSE(em::with_less_variation(same.ab, same.cd, unweighted(size)));
}

}  // namespace
}  // namespace tokid
