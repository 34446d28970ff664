// SPDX-License-Identifier: BSD-3-Clause
#include "model/archived.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "testing.hpp"

namespace tokid::archive {
namespace {

// A size in the place of the first one, before so many bytes.
std::string claiming(std::uint64_t size, size_t more = 64) {
  std::string bytes(sizeof size + more, '\0');
  std::memcpy(bytes.data(), &size, sizeof size);
  return bytes;
}

TEST(Archive, ValuesComeBack) {
  Model model;
  model.step = {Step(3, 2, 1, 1), Step(2, 0, 1, 1)};
  model.step[0].A().setRandom();
  model.step[0].set_singular_values(Vector::Random(5));
  model.step[1].set_R(Matrix::Ones(1, 1));
  model.names.input_names = {"force", ""};
  model.x0_mean = Vector::Random(3);
  const Model back = unpacked<Model>(packed(model));
  ASSERT_EQ(back.step.size(), 2u);
  EXPECT_EQ(back.step[0].A(), model.step[0].A());
  EXPECT_EQ(back.step[0].singular_values(), model.step[0].singular_values());
  EXPECT_TRUE(back.step[1].has_R() && !back.step[1].has_Q());
  EXPECT_EQ(back.step, model.step);
  EXPECT_EQ(testing::state_dims(back), testing::state_dims(model));
  EXPECT_EQ(back.names.input_names, model.names.input_names);
  EXPECT_EQ(back.x0_mean, model.x0_mean);
}

TEST(Archive, NoMemoryIsTakenThatTheBytesAreNotWorth) {
  for (const std::uint64_t size :
       {std::uint64_t{9}, std::uint64_t{1} << 40, std::uint64_t{1} << 63, ~std::uint64_t{0}}) {
    EXPECT_THROW(unpacked<std::vector<double>>(claiming(size)), std::runtime_error) << size;
    EXPECT_THROW(unpacked<std::vector<std::string>>(claiming(size)), std::runtime_error) << size;
    EXPECT_THROW(unpacked<std::vector<Step>>(claiming(size)), std::runtime_error) << size;
    EXPECT_THROW(unpacked<Vector>(claiming(size)), std::runtime_error) << size;
    EXPECT_THROW(unpacked<Matrix>(claiming(size)), std::runtime_error) << size;
    EXPECT_THROW(unpacked<std::string>(claiming(size, 8)), std::runtime_error) << size;
  }
  std::string both = claiming(1 << 20, 8);  // rows and columns whose product is beyond
  both.replace(8, 8, both.substr(0, 8));
  EXPECT_THROW(unpacked<Matrix>(both), std::runtime_error);
}

TEST(Archive, ContradictorySteps) {
  Step step(2, 2, 1, 1);
  step.set_rank(3);
  std::string bytes = packed(step);
  EXPECT_EQ(unpacked<Step>(bytes), step);
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  std::memcpy(bytes.data() + bytes.size() - sizeof(double), &no_number, sizeof(double));
  EXPECT_THROW(unpacked<Step>(bytes), std::runtime_error);
  for (size_t i = 0; i < 6 * sizeof(std::int32_t); i += sizeof(std::int32_t))
    for (const std::int32_t value : {-1, 7, 1 << 30}) {
      bytes = packed(step);
      std::memcpy(bytes.data() + i, &value, sizeof value);
      EXPECT_THROW(unpacked<Step>(bytes), std::runtime_error) << i << " " << value;
    }
}

TEST(Archive, CutAndLongerBytesAreRefused) {
  Model model;
  model.step = {Step(2, 2, 1, 1)};
  const std::string bytes = packed(model);
  for (size_t size = 0; size < bytes.size(); ++size)
    EXPECT_THROW(unpacked<Model>(bytes.substr(0, size)), std::runtime_error) << size;
  EXPECT_THROW(unpacked<Model>(bytes + '\0'), std::runtime_error);
  EXPECT_THROW(unpacked<std::optional<double>>("\2........"), std::runtime_error);
}

}  // namespace
}  // namespace tokid::archive
