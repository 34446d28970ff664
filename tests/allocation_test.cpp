// What must not allocate: this program counts every call of malloc, Eigen's included.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>

#include "testing.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/online_observer.hpp"

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {
std::atomic<long> allocations{0};
}

extern "C" {
void* __libc_malloc(std::size_t);  // NOLINT: the C library's own name

void* malloc(std::size_t size) {
  allocations.fetch_add(1, std::memory_order_relaxed);
  return __libc_malloc(size);
}
}

namespace tokid {
namespace {

using testing::Random;

long allocations_of(const Ensemble& e, const GtvArxOptions& options) {
  const long before = allocations;
  gtv_arx(e, options);
  return allocations - before;
}

TEST(Allocation, IsCounted) {
  const long before = allocations;
  const Matrix a = Matrix::Zero(10, 10);
  EXPECT_EQ(allocations - before, 1) << a(0, 0);
}

// However many steps: as many allocations, in every route.
TEST(Allocation, RegressionsAllocateNothingForAStep) {
  for (const Index block : {0, 1, 3}) {
    GtvArxOptions options;
    options.lags = {3};
    options.block = block;
    long counts[2];
    for (const Index steps : {320, 1600}) {
      Ensemble e(40, steps, 2, 2);
      Random random(1);
      for (Index k = 0; k < steps; ++k) {
        e.input(k) = random.matrix(40, 2);
        e.output(k) = random.matrix(40, 2);
      }
      allocations_of(e, options);  // whatever is set up once
      counts[steps == 1600] = allocations_of(e, options);
    }
    EXPECT_LE(counts[1], counts[0] + 4) << block;  // pieces of the loop may differ by one
    EXPECT_LE(counts[0], 1000) << block;
  }
}

// With and without missing outputs, while the state dimension changes, and in the Kalman filter.
TEST(Allocation, StepsOfTheOnlineObserverAllocateNothing) {
  Random random(1);
  for (const bool filter : {false, true}) {
    Model model = testing::random_system({4, 2, 2}, 100, 0.9, 2);
    if (!filter) {
      const Step last = model.step[50];
      model.step[50] = Step(last.A().topRows(3), last.B().topRows(3), last.C(), last.D(), last.G().topRows(3));
      const Step after = model.step[51];
      model.step[51] = Step(after.A().leftCols(3), after.B(), after.C().leftCols(3), after.D(), after.G());
    }
    for (Step& step : model.step) {
      step.set_innovation_cov(Matrix::Identity(2, 2));
      if (!filter) continue;
      step.set_Q(Matrix::Identity(4, 4));
      step.set_R(Matrix::Identity(2, 2));
    }
    OnlineObserver observer(std::move(model), {.samples_missing = filter});
    const Matrix inputs = random.matrix(5, 2);
    Matrix outputs(5, 2);
    Vector u(2), y(2), x(4);
    long counted = 0;
    for (Index k = 0; k < 90; ++k) {
      for (double& value : u) value = random.normal();
      for (double& value : y) value = random.normal();
      if (k % 3 == 1) y(k % 2) = testing::nan;
      const long before = allocations;
      observer.predict(inputs, outputs);
      observer.step(u, y);
      observer.copy_state(x.head(observer.states()));
      if (k > 2) counted += allocations - before;  // by then the filter has all its memory
    }
    EXPECT_EQ(counted, 0) << filter;
  }
}

}  // namespace
}  // namespace tokid

#endif
