// A single bit that changed in a file which tokid wrote: the file is refused, or all that it says is the same. A table
// is read, but with a remark. TOKID_FLIPS=1000 build/bin/tokid_tests --gtest_filter='*Integrity*' tries so many bits of
// each file.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <random>

#include "model/archived.hpp"
#include "testing.hpp"
#include "tokid/io.hpp"
#include "tokid/update.hpp"

namespace tokid {
namespace {

using testing::random_experiments;
using testing::random_system;
using testing::with_noise;

namespace fs = std::filesystem;

// ---- all that a file says, to the last bit ----

std::string content(const Ensemble& e) {
  archive::Writer all;
  all(e.inputs(), e.outputs(), Matrix(e.samples()), e.dt, e.initial_state, e.length, e.names, e.experiment_names,
      e.free.experiments, e.free.steps, e.free.y);
  return all.bytes();
}

std::string content(const Model& model) { return archive::packed(model); }

std::string content(const UpdateState& state) {
  archive::Writer all;
  const WindowFactors& f = state.factors;
  all(f.inputs, f.outputs, f.lags, f.initial_state, f.dt, f.names, f.experiments, f.rows, f.factor, f.count, f.sum,
      f.spread, state.provenance, state.plan.method, state.plan.states, state.plan.coupled, state.plan.noisy,
      state.plan.nominal, state.digests, state.without_digest);
  return all.bytes();
}

// ---- what is written: small and chunked data sets, texts, lists, missing samples ----

Ensemble ensemble() {
  Ensemble e = with_noise(random_experiments(random_system({3, 2, 2}, 90, 0.9, 3), 40, 4), 0.05, 5);
  e.y(3, 7, 1) = std::numeric_limits<double>::quiet_NaN();
  e.dt = 0.02;
  e.initial_state = InitialState::zero;
  e.names = {{"torque", "force"}, {"angle", "Größe"}, {"N m", "N"}, {"rad", "m"}};
  return e;
}

// With few choices left, which takes less time.
IdentifyOptions options_of_models() {
  IdentifyOptions options;
  options.lags = 2;
  options.states = 3;
  options.method = Method::subspace;
  return options;
}

Ensemble with_lists(Ensemble e) {
  for (Index n = 0; n < e.experiments(); ++n) e.length.push_back(e.steps() - n % 3);
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index k = e.length[size_t(n)]; k < e.steps(); ++k) {
      e.input(k).row(n).setConstant(std::numeric_limits<double>::quiet_NaN());
      e.output(k).row(n).setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  for (Index n = 0; n < e.experiments(); ++n) e.experiment_names.push_back("run " + std::to_string(n + 101));
  e.free = {5, 8, Matrix::Random(5, 8 * e.outputs())};
  return e;
}

struct Case {
  const char* name;
  const char* extension;
  bool mat73;
};

std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

class Integrity : public ::testing::TestWithParam<Case> {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / ("tokid-integrity-" + std::to_string(getpid()));
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }

  fs::path path() const { return directory_ / (std::string("file") + GetParam().extension); }
  WriteOptions options() const { return {GetParam().mat73}; }

  // `read` delivers all that the file says, nothing where it says that it has been changed.
  void flip_bits(const std::function<std::string()>& read) const {
    const std::string expected = read();
    ASSERT_NE(expected, "");
    std::fstream file(path(), std::ios::in | std::ios::out | std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    const char* wanted = std::getenv("TOKID_FLIPS");
    const int count = wanted ? std::stoi(wanted) : 100;
    std::mt19937_64 random(27);
    int refused = 0, told = 0, same = 0;
    for (int i = 0; i < count; ++i) {
      const size_t bit = random() % (8 * bytes.size());
      const auto put = [&](char byte) { file.seekp(std::streamoff(bit / 8)).put(byte).flush(); };
      put(char(bytes[bit / 8] ^ (1 << bit % 8)));
      try {
        const std::string found = read();
        const bool is_told = found.empty(), equal = found == expected;
        EXPECT_TRUE(is_told || equal) << "byte " << bit / 8 << ", bit " << bit % 8 << ": other data were read";
        told += is_told ? 1 : 0;
        same += equal ? 1 : 0;
      } catch (const IoError&) {
        ++refused;
      }
      put(bytes[bit / 8]);
    }
    EXPECT_EQ(read(), expected);
    // Whatever bit it is: its checksum is that of the whole file.
    EXPECT_EQ(std::string(GetParam().name) == "csv" ? same : 0, 0);
    std::cout << GetParam() << ": " << bytes.size() << " bytes, " << count << " bits changed, " << refused
              << " files refused, " << told << " told to be changed, " << same << " read the same, "
              << count - refused - told - same << " read otherwise\n";
  }

 private:
  fs::path directory_;
};

INSTANTIATE_TEST_SUITE_P(Formats, Integrity,
                         ::testing::Values(Case{"npz", ".npz", false}, Case{"h5", ".h5", false},
                                           Case{"mat version 7", ".mat", false},
                                           Case{"mat version 7.3", ".mat", true}));
// In which there are no models and states.
class IntegrityOfTables : public Integrity {};
INSTANTIATE_TEST_SUITE_P(Formats, IntegrityOfTables, ::testing::Values(Case{"csv", ".csv", false}));

TEST_P(Integrity, OfEnsembles) {
  save_ensemble(with_lists(ensemble()), path(), options());
  flip_bits([&] { return content(load_ensemble(path())); });
}

TEST_P(IntegrityOfTables, OfEnsembles) {
  Ensemble written = with_lists(ensemble());
  written.free = {};  // which don't fit into them
  save_ensemble(written, path());
  flip_bits([&] {
    const Ensemble e = load_ensemble(path());
    const auto is_about_change = [](const std::string& text) {
      return text.find("changed after") != std::string::npos;
    };
    return std::any_of(e.remarks.begin(), e.remarks.end(), is_about_change) ? std::string() : content(e);
  });
}

TEST_P(Integrity, OfModels) {
  save_model(identify(ensemble(), options_of_models()).model, path(), options());
  flip_bits([&] { return content(load_model(path())); });
}

TEST_P(Integrity, OfStates) {
  if (GetParam().mat73) GTEST_SKIP() << "states are never written in this version";
  const Ensemble e = ensemble();
  save_update_state(update_state(e, identify(e, options_of_models()), options_of_models()), path());
  flip_bits([&] { return content(load_update_state(path())); });
}

}  // namespace
}  // namespace tokid
