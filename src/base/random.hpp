// Random numbers that are equal on every machine. The standard library does not guarantee this for its distributions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <boost/random/mersenne_twister.hpp>
#include <boost/random/normal_distribution.hpp>
#include <boost/random/uniform_01.hpp>
#include <boost/random/uniform_int_distribution.hpp>
#include <cstdint>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

class RandomNumbers {
 public:
  explicit RandomNumbers(std::uint64_t seed) : engine_(seed) {}

  double normal() { return normal_(engine_); }
  double uniform() { return boost::random::uniform_01<double>()(engine_); }  // 0 ≤ x < 1
  double sign() { return uniform() < 0.5 ? -1.0 : 1.0; }

  Vector normals(Index size) {
    Vector x(size);
    for (double& value : x) value = normal();
    return x;
  }
  Vector signs(Index size) {
    Vector x(size);
    for (double& value : x) value = sign();
    return x;
  }
  // 0 … size-1 in random order
  std::vector<Index> permutation(Index size) {
    std::vector<Index> order(static_cast<size_t>(size));
    for (Index i = 0; i < size; ++i) {
      const Index j = boost::random::uniform_int_distribution<Index>(0, i)(engine_);
      order[size_t(i)] = order[size_t(j)];
      order[size_t(j)] = i;
    }
    return order;
  }

 private:
  boost::random::mt19937_64 engine_;
  boost::random::normal_distribution<double> normal_;
};

}  // namespace tokid
