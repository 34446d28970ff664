// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/io.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <optional>
#include <random>

#include "io/formats/formats.hpp"
#include "io/formats/provenance_text.hpp"
#include "io/guard/claims.hpp"
#include "io/guard/text_checksum.hpp"
#include "model/step_fields.hpp"

// NOLINTBEGIN(bugprone-reserved-identifier, readability-identifier-naming): the sanitizers look for these names
// A damaged file may make the HDF5 library ask for more memory than there is, and it copes with getting none.
extern "C" const char* __asan_default_options() { return "allocator_may_return_null=1"; }
// It also forgets some memory when it meets damage.
extern "C" const char* __lsan_default_suppressions() { return "leak:libhdf5"; }
// NOLINTEND(bugprone-reserved-identifier, readability-identifier-naming)

namespace tokid {
namespace {

namespace fs = std::filesystem;

constexpr double missing = std::numeric_limits<double>::quiet_NaN();
constexpr double infinite = std::numeric_limits<double>::infinity();

// ---- tools ----

class Io : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string(test->test_suite_name()) + "." + test->name();
    for (char& c : name)
      if (c == '/') c = '_';
    directory_ = fs::temp_directory_path() / ("tokid-io-" + std::to_string(getpid()) + "-" + name);
    fs::create_directories(directory_);
  }
  void TearDown() override {
    fs::permissions(directory_, fs::perms::owner_all);
    fs::remove_all(directory_);
  }

  fs::path file(const std::string& name) const { return directory_ / name; }

  size_t number_of_files() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(directory_), fs::directory_iterator()));
  }

 private:
  fs::path directory_;
};

std::string bytes_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write_bytes(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

// The message of the IoError that f must throw.
template <typename F>
std::string error_of(F&& f) {
  try {
    f();
  } catch (const IoError& error) {
    std::string text = error.what();
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    return text;
  } catch (const std::exception& error) {
    ADD_FAILURE() << "no IoError but: " << error.what();
    return "";
  }
  ADD_FAILURE() << "no IoError";
  return "";
}

void expect_words(const std::string& message, const std::vector<std::string>& words) {
  for (const auto& word : words) EXPECT_NE(message.find(word), std::string::npos) << message << "\nlacks: " << word;
}

void expect_load_error(const fs::path& path, std::vector<std::string> words, const ReadOptions& options = {}) {
  words.push_back(path.filename().string() + ": ");
  expect_words(error_of([&] { load_ensemble(path, options); }), words);
}

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

bool same(const Matrix& a, const Matrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
  for (Index i = 0; i < a.rows(); ++i)
    for (Index j = 0; j < a.cols(); ++j)
      if (!same(a(i, j), b(i, j))) return false;
  return true;
}

void expect_same(const Channels& a, const Channels& b) {
  EXPECT_EQ(a.input_names, b.input_names);
  EXPECT_EQ(a.output_names, b.output_names);
  EXPECT_EQ(a.input_units, b.input_units);
  EXPECT_EQ(a.output_units, b.output_units);
}

void expect_same(const Ensemble& a, const Ensemble& b) {
  EXPECT_EQ(a.experiments(), b.experiments());
  EXPECT_EQ(a.steps(), b.steps());
  EXPECT_EQ(a.inputs(), b.inputs());
  EXPECT_EQ(a.outputs(), b.outputs());
  EXPECT_TRUE(same(a.samples(), b.samples()));
  EXPECT_EQ(a.dt, b.dt);
  EXPECT_EQ(a.initial_state, b.initial_state);
  EXPECT_EQ(a.length, b.length);
  EXPECT_EQ(a.experiment_names, b.experiment_names);
  expect_same(a.names, b.names);
  EXPECT_EQ(a.free.experiments, b.free.experiments);
  EXPECT_EQ(a.free.steps, b.free.steps);
  EXPECT_TRUE(same(a.free.y, b.free.y));
}

bool same(const Step& a, const Step& b) {
  if (a.states() != b.states() || a.next_states() != b.next_states() ||
      a.has_singular_values() != b.has_singular_values() || a.has_condition() != b.has_condition() ||
      a.has_rank() != b.has_rank() || a.has_lags() != b.has_lags())
    return false;
  for (const StepField& field : step_fields::all)
    if (field.known(a) != field.known(b) ||
        (field.known(a) && !same(Matrix((a.*field.view)()), Matrix((b.*field.view)()))))
      return false;
  return (!a.has_singular_values() || same(Matrix(a.singular_values()), Matrix(b.singular_values()))) &&
         (!a.has_condition() || same(a.condition(), b.condition())) && (!a.has_rank() || a.rank() == b.rank()) &&
         (!a.has_lags() || a.lags() == b.lags());
}

void expect_same(const Model& a, const Model& b) {
  EXPECT_EQ(a.inputs, b.inputs);
  EXPECT_EQ(a.outputs, b.outputs);
  EXPECT_EQ(a.k_begin, b.k_begin);
  EXPECT_EQ(a.dt, b.dt);
  EXPECT_TRUE(std::equal(a.step.begin(), a.step.end(), b.step.begin(), b.step.end(),
                         [](const Step& x, const Step& y) { return same(x, y); }));
  EXPECT_EQ(a.frame, b.frame);
  EXPECT_EQ(a.method, b.method);
  EXPECT_EQ(a.initial_state, b.initial_state);
  expect_same(a.names, b.names);
  EXPECT_TRUE(same(a.u_nominal, b.u_nominal) && same(a.y_nominal, b.y_nominal));
  EXPECT_TRUE(same(Matrix(a.x0_mean), Matrix(b.x0_mean)) && same(a.x0_cov, b.x0_cov));
  EXPECT_EQ(io::provenance_text(a.provenance), io::provenance_text(b.provenance));
  EXPECT_EQ(a.provenance.version, b.provenance.version);
}

// ---- random ensembles and models ----

using Random = std::mt19937_64;

double gaussian(Random& random) { return std::normal_distribution<double>()(random); }

Matrix gaussian(Random& random, Index rows, Index cols) {
  return Matrix::NullaryExpr(rows, cols, [&] { return gaussian(random); });
}

bool coin(Random& random) { return (random() & 1) != 0; }

Index between(Random& random, Index low, Index high) { return std::uniform_int_distribution<Index>(low, high)(random); }

Ensemble random_ensemble(Random& random, Index n_exp, Index steps, Index r, Index m) {
  Ensemble e(n_exp, steps, r, m, 0.01 * std::exp(gaussian(random)));
  for (Index n = 0; n < n_exp; ++n)
    for (Index k = 0; k < steps; ++k) {
      for (Index i = 0; i < r; ++i) e.u(n, k, i) = gaussian(random);
      for (Index j = 0; j < m; ++j) e.y(n, k, j) = gaussian(random);
    }
  return e;
}

const std::vector<std::string> odd_names{"plain",      "with, comma",     "\"quoted\"",
                                         "two\nlines", " blanks around ", "Größe ϑ · 角度 🚀",
                                         "a#b",        "semi;colon",      "tab\there"};

Channels odd_channels(Index r, Index m) {
  Channels channels;
  for (Index i = 0; i < r + m; ++i) {
    const std::string name = odd_names[static_cast<size_t>(i) % odd_names.size()] + std::to_string(i);
    (i < r ? channels.input_names : channels.output_names).push_back(name);
    (i < r ? channels.input_units : channels.output_units).emplace_back(i % 2 == 0 ? "" : "N·m, \"²\"");
  }
  return channels;
}

std::vector<std::string> odd_experiments(Index experiments) {
  std::vector<std::string> names;
  for (Index n = 0; n < experiments; ++n)
    names.push_back(odd_names[static_cast<size_t>(n) % odd_names.size()] + std::to_string(n));
  return names;
}

void drop_samples(Random& random, Ensemble& e) {
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index k = 0; k < e.steps(); ++k)
      for (Index j = 0; j < e.outputs(); ++j)
        if (n + k > 0 && random() % 4 == 0) e.y(n, k, j) = missing;
}

void shorten(Random& random, Ensemble& e) {
  for (Index n = 0; n < e.experiments(); ++n) {
    const Index length = n == 0 ? e.steps() : between(random, 0, e.steps());
    e.length.push_back(length);
    for (Index k = length; k < e.steps(); ++k) {
      e.input(k).row(n).setConstant(missing);
      e.output(k).row(n).setConstant(missing);
    }
  }
}

void add_free_response(Random& random, Ensemble& e) {
  e.free.experiments = between(random, 1, 3);
  e.free.steps = between(random, 1, 5);
  e.free.y = gaussian(random, e.free.experiments, e.free.steps * e.outputs());
}

Model random_model(Random& random, Index S, Index n, Index r, Index m, bool optional_fields) {
  Model model;
  model.inputs = r;
  model.outputs = m;
  model.dt = 0.05;
  for (Index s = 0, states = between(random, 0, n); s < S; ++s) {
    const Index next = between(random, 0, n);
    model.step.emplace_back(states, next, r, m);
    states = next;
  }
  for (const StepField& field : step_fields::all)
    for (Step& step : model.step)
      if (!field.optional || optional_fields)
        field.set(step, gaussian(random, size(step, field.rows), size(step, field.cols)));
  if (!optional_fields) return model;

  model.k_begin = between(random, 0, 7);
  model.frame = "smooth";
  model.method = "tvera";
  model.initial_state = InitialState::unknown;
  model.names = odd_channels(r, m);
  model.x0_mean = gaussian(random, model.n(model.k_begin), 1);
  model.x0_cov = gaussian(random, model.n(model.k_begin), model.n(model.k_begin));
  for (Index s = 0; s < S; ++s) {
    Step& step = model.step[size_t(s)];
    step.set_singular_values(gaussian(random, between(random, 0, 4), 1));
    step.set_condition(s == 1 ? infinite : gaussian(random));
    step.set_rank(between(random, 0, 9));
    step.set_lags(between(random, 0, 9));
  }
  model.u_nominal = gaussian(random, S + 3, r);
  model.y_nominal = gaussian(random, S + 3, m);
  model.provenance = io::provenance_of(R"({"lags": "auto", "text": "a \"quoted\" word, ü"})", "1.2.3");
  return model;
}

struct FormatCase {
  const char* extension;
  bool mat73;
};

std::ostream& operator<<(std::ostream& out, const FormatCase& format) {
  return out << format.extension << (format.mat73 ? " v7.3" : "");
}

class EveryFormat : public Io, public testing::WithParamInterface<FormatCase> {
 protected:
  fs::path target() const { return file(std::string("file") + GetParam().extension); }
  WriteOptions options() const { return {GetParam().mat73}; }
};

INSTANTIATE_TEST_SUITE_P(Formats, EveryFormat,
                         testing::Values(FormatCase{".npz", false}, FormatCase{".h5", false},
                                         FormatCase{".hdf5", false}, FormatCase{".mat", false},
                                         FormatCase{".mat", true}, FormatCase{".csv", false}));

class BinaryFormat : public EveryFormat {};
INSTANTIATE_TEST_SUITE_P(Formats, BinaryFormat,
                         testing::Values(FormatCase{".npz", false}, FormatCase{".h5", false}, FormatCase{".mat", false},
                                         FormatCase{".mat", true}));

// ---- round trips ----

TEST_P(EveryFormat, EnsembleComesBackAsItWas) {
  const bool csv = std::string(GetParam().extension) == ".csv";
  for (int seed = 0; seed < 30; ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(seed));
    const Index sizes[] = {1, 1, 2, 3, 7};
    const auto size = [&] { return sizes[random() % std::size(sizes)]; };
    Ensemble e = random_ensemble(random, size(), size(), size(), size());
    if (coin(random)) drop_samples(random, e);
    if (coin(random)) shorten(random, e);
    if (coin(random)) e.names = odd_channels(e.inputs(), e.outputs());
    if (coin(random)) e.initial_state = coin(random) ? InitialState::zero : InitialState::unknown;
    if (!csv && coin(random)) add_free_response(random, e);
    if (coin(random)) e.experiment_names = odd_experiments(e.experiments());
    save_ensemble(e, target(), options());
    EXPECT_EQ(file_kind(target()), FileKind::ensemble);
    expect_same(load_ensemble(target()), e);
    EXPECT_EQ(number_of_files(), 1u);
    if (Test::HasFailure()) break;
  }
}

TEST_P(EveryFormat, ExtremeNumbersKeepEveryBit) {
  Ensemble e(1, 6, 1, 1, 1.0 / 3.0);
  const double values[] = {0.1, -0.0, 5e-324, 1.7976931348623157e308, 1.0 / 3.0, -1e22};
  for (Index k = 0; k < 6; ++k) e.u(0, k, 0) = e.y(0, k, 0) = values[k];
  save_ensemble(e, target(), options());
  const Ensemble back = load_ensemble(target());
  expect_same(back, e);
  EXPECT_TRUE(std::signbit(back.u(0, 1, 0)));
}

TEST_P(EveryFormat, InputsAlone) {
  Random random(1);
  const Ensemble e = random_ensemble(random, 3, 4, 2, 0);
  save_ensemble(e, target(), options());
  expect_same(load_ensemble(target(), {{}, {}, false}), e);
  expect_load_error(target(), {"y", "'u", "found"});
}

TEST_P(BinaryFormat, ModelComesBackAsItWas) {
  for (int seed = 0; seed < 30; ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(seed));
    const Model model = random_model(random, between(random, 1, 6), between(random, 0, 4), between(random, 1, 3),
                                     between(random, 1, 3), coin(random));
    save_model(model, target(), options());
    EXPECT_EQ(file_kind(target()), FileKind::model);
    expect_same(load_model(target()), model);
    EXPECT_EQ(number_of_files(), 1u);
    if (Test::HasFailure()) break;
  }
}

TEST_F(Io, SameDataSameBytes) {
  Random random(1);
  const Ensemble e = random_ensemble(random, 3, 4, 2, 1);
  const std::vector<FormatCase> formats{
      {".npz", false}, {".h5", false}, {".mat", false}, {".mat", true}, {".csv", false}};
  const auto write_all = [&] {
    std::vector<std::string> bytes;
    for (const auto& format : formats) {
      const fs::path path = file(std::string("a") + format.extension);
      save_ensemble(e, path, {format.mat73});
      bytes.push_back(bytes_of(path));
    }
    return bytes;
  };
  const auto first = write_all();
  sleep(2);  // the clock of zip archives ticks every two seconds
  EXPECT_EQ(first, write_all());
}

TEST_F(Io, UnstatedChannelNamesStayUnstated) {
  write_bytes(file("a.csv"), "experiment,time,u1,y1,y2\n0,0,1,2,3\n0,0.1,4,5,6\n");
  const Ensemble e = load_ensemble(file("a.csv"));
  EXPECT_TRUE(e.names.input_names.empty());
  EXPECT_TRUE(e.names.output_names.empty());
  EXPECT_EQ(e.dt, 0.1);
}

TEST_F(Io, MatlabLayoutSurvivesAnotherExtension) {
  Random random(1);
  const Ensemble e = random_ensemble(random, 2, 5, 1, 3);
  save_ensemble(e, file("a.mat"), {true});
  fs::rename(file("a.mat"), file("a.h5"));
  expect_same(load_ensemble(file("a.h5")), e);
  const Model model = random_model(random, 4, 3, 2, 1, true);
  save_model(model, file("m.mat"), {true});
  fs::rename(file("m.mat"), file("m.hdf5"));
  expect_same(load_model(file("m.hdf5")), model);
}

// ---- shapes ----

using io::Array;
using io::Arrays;
using io::Shape;

Array numbers(const Shape& shape, double value = 1.0) {
  return {shape, std::vector<double>(io::checked_product(shape), value)};
}

Array ramp(const Shape& shape) {
  Array array = numbers(shape);
  double next = 0;
  for (double& x : std::get<std::vector<double>>(array.values)) x = next++;
  return array;
}

Array texts(const Shape& shape) { return {shape, std::vector<std::string>(io::checked_product(shape), "text")}; }

class Shapes : public Io {
 protected:
  fs::path npz(const Arrays& arrays) const { return io::write_npz(arrays, file("a.npz")), file("a.npz"); }
  fs::path mat(const Arrays& arrays) const { return io::write_mat(arrays, file("a.mat")), file("a.mat"); }
};

TEST_F(Shapes, TwoDimensionsAreOneExperiment) {
  for (const auto& path :
       {npz({{"u", ramp({5, 2})}, {"y", ramp({5, 1})}}), mat({{"u", ramp({5, 2})}, {"y", ramp({5, 1})}})}) {
    const Ensemble e = load_ensemble(path);
    EXPECT_EQ(e.experiments(), 1);
    EXPECT_EQ(e.steps(), 5);
    EXPECT_EQ(e.u(0, 3, 1), 7);
    EXPECT_EQ(e.y(0, 3, 0), 3);
  }
}

TEST_F(Shapes, OneExperimentMayLackItsFirstDimensionInOneArray) {
  const Ensemble e = load_ensemble(npz({{"u", ramp({1, 5, 2})}, {"y", ramp({5, 3})}}));
  EXPECT_EQ(e.experiments(), 1);
  EXPECT_EQ(e.y(0, 2, 1), 7);
}

TEST_F(Shapes, AmbiguousChannelDimensionIsRefused) {
  expect_load_error(npz({{"u", ramp({4, 5, 2})}, {"y", ramp({4, 5})}}), {"'y'", "(4, 5)", "(4, 5, 1)", "'u'"});
  expect_load_error(npz({{"u", ramp({4, 5})}, {"y", ramp({4, 5, 2})}}), {"'u'", "(4, 5)", "(4, 5, 1)", "'y'"});
}

TEST_F(Shapes, MatlabDropsTrailingOnes) {
  const Ensemble e = load_ensemble(mat({{"u", ramp({4, 5})}, {"y", ramp({4, 5, 2})}}));
  EXPECT_EQ(e.experiments(), 4);
  EXPECT_EQ(e.inputs(), 1);
  EXPECT_EQ(e.u(2, 3, 0), 13);
  const Ensemble siso = load_ensemble(mat({{"experiments", numbers({}, 4)}, {"u", ramp({4, 5})}, {"y", ramp({4, 5})}}));
  EXPECT_EQ(siso.experiments(), 4);
  EXPECT_EQ(siso.outputs(), 1);
  EXPECT_EQ(siso.y(2, 3, 0), 13);
  expect_load_error(mat({{"experiments", numbers({}, 3)}, {"u", ramp({4, 5})}, {"y", ramp({4, 5})}}),
                    {"'u'", "(4, 5)", "3 rows"});
}

TEST_F(Shapes, OtherShapesAreRefused) {
  expect_load_error(npz({{"u", ramp({5})}, {"y", ramp({5, 1})}}), {"'u'", "(5)", "(N, T, channels)"});
  expect_load_error(npz({{"u", ramp({2, 5, 1})}, {"y", ramp({1, 2, 5, 1})}}), {"'y'", "(1, 2, 5, 1)"});
  expect_load_error(npz({{"u", ramp({2, 5, 1})}, {"y", ramp({2, 6, 1})}}), {"'y'", "(2, 6, 1)", "(2, 5, channels)"});
  expect_load_error(npz({{"u", ramp({2, 5, 1})}, {"y", ramp({3, 5, 1})}}), {"'y'", "(3, 5, 1)"});
  expect_load_error(npz({{"u", ramp({5, 1})}, {"y", ramp({6, 1})}}), {"'y'", "(6, 1)", "(5, channels)"});
  expect_load_error(npz({{"u", ramp({2, 5, 1})}, {"y", ramp({6, 1})}}), {"'y'", "(6, 1)"});
  expect_load_error(npz({{"u", ramp({2, 0, 1})}, {"y", ramp({2, 0, 1})}}), {"'u'", "(2, 0, 1)"});
  expect_load_error(npz({{"u", ramp({0, 5, 1})}, {"y", ramp({0, 5, 1})}}), {"'u'", "(0, 5, 1)"});
}

TEST_F(Shapes, OptionalFieldsAreChecked) {
  const auto with = [&](const std::string& name, const Array& array) {
    return npz({{name, array}, {"u", ramp({2, 5, 1})}, {"y", ramp({2, 5, 1})}});
  };
  EXPECT_EQ(load_ensemble(with("length", {{2}, std::vector<std::int64_t>{5, 3}})).missing(), 4);
  EXPECT_EQ(load_ensemble(with("length", {{2, 1}, std::vector<double>{5, 3}})).missing(), 4);
  EXPECT_EQ(load_ensemble(with("dt", numbers({1, 1}, 0.5))).dt, 0.5);
  expect_load_error(with("length", numbers({3})), {"'length'", "(3)", "(2)"});
  expect_load_error(with("length", numbers({2}, 6)), {"'length'", "6", "from 0 to 5"});
  expect_load_error(with("length", numbers({2}, -1)), {"'length'", "-1"});
  expect_load_error(with("length", numbers({2}, 2.5)), {"'length'", "2.5"});
  expect_load_error(with("length", numbers({2}, missing)), {"'length'", "nan"});
  expect_load_error(with("length", texts({2})), {"'length'", "text found", "numbers needed"});
  expect_load_error(with("dt", numbers({}, 0)), {"dt", "0 found"});
  expect_load_error(with("dt", numbers({}, infinite)), {"dt", "inf found"});
  expect_load_error(with("dt", numbers({2})), {"'dt'", "(2)", "one number"});
  expect_load_error(with("initial_state", texts({})), {"initial_state", "text", "zero"});
  expect_load_error(with("initial_state", numbers({})), {"'initial_state'", "numbers found", "text needed"});
  expect_load_error(with("input_names", texts({2})), {"input_names", "2"});
  expect_load_error(with("output_units", numbers({1})), {"'output_units'", "numbers found", "text needed"});
  using Texts = std::vector<std::string>;
  const auto named = [&](const Array& names) {
    return load_ensemble(with("experiment_names", names)).experiment_names;
  };
  EXPECT_EQ(named({{2}, Texts{"17", "a"}}), (Texts{"17", "a"}));
  EXPECT_EQ(named({{2, 1}, std::vector<double>{17, 0.5}}), (Texts{"17", "0.5"}));
  EXPECT_EQ(named({{2}, std::vector<std::int64_t>{1, 0}}), (Texts{"1", "0"}));
  EXPECT_EQ(named({{2}, std::vector<std::int64_t>{0, 1}}), Texts{});
  expect_load_error(with("experiment_names", {{2}, Texts{"a", "a"}}), {"\"a\" found at rows 0 and 1"});
  expect_load_error(with("experiment_names", numbers({2}, 4)), {"\"4\" found at rows 0 and 1"});
  expect_load_error(with("experiment_names", {{2}, Texts{"a", ""}}), {"an empty text found at row 1"});
  expect_load_error(with("experiment_names", texts({3})), {"experiment_names: 3 names found for 2 experiments"});
  EXPECT_EQ(load_ensemble(with("free_y", ramp({3, 4, 1}))).free.experiments, 3);
  EXPECT_EQ(load_ensemble(with("free_y", ramp({4, 1}))).free.experiments, 1);
  expect_load_error(with("free_y", ramp({3, 4})), {"'free_y'", "(3, 4)"});
  expect_load_error(with("free_y", ramp({3, 4, 2})), {"'free_y'", "(3, 4, 2)"});
  expect_load_error(with("free_y", numbers({3, 4, 1}, infinite)), {"free_y", "infinite"});
  EXPECT_EQ(load_ensemble(with("something else", texts({2}))).steps(), 5);
}

TEST_F(Shapes, WrongTypesAreRefused) {
  expect_load_error(npz({{"u", texts({2, 5, 1})}, {"y", ramp({2, 5, 1})}}),
                    {"'u'", "text found", "real numbers needed"});
  expect_load_error(mat({{"u", ramp({2, 5, 1})}, {"y", texts({})}}), {"'y'", "text found", "real numbers needed"});
}

TEST_F(Shapes, ImpossibleSamplesAreNamed) {
  Array y = ramp({2, 5, 2});
  std::get<std::vector<double>>(y.values)[13] = infinite;  // experiment 1, step 1, channel 1
  expect_load_error(npz({{"u", ramp({2, 5, 1})}, {"y", y}}), {"y2", "infinite", "experiment 1", "step 1"});
  expect_load_error(npz({{"u", ramp({2, 5, 1})}, {"y", numbers({2, 5, 1}, missing)}}), {"y1", "missing"});
}

// ---- models that are none ----

Arrays model_arrays() {
  return {{"state_dim", numbers({4}, 2)}, {"D", ramp({3, 1, 1})}, {"C", ramp({3, 1, 2})},
          {"B", ramp({3, 2, 1})},         {"A", ramp({3, 2, 2})}, {"G", ramp({3, 2, 1})}};
}

TEST_F(Shapes, ModelFieldsAreChecked) {
  const auto error_with = [&](const std::string& name, const std::optional<Array>& array) {
    Arrays arrays = model_arrays();
    std::erase_if(arrays, [&](const auto& entry) { return entry.first == name; });
    if (array) arrays.emplace_back(name, *array);
    return error_of([&] { load_model(npz(arrays)); });
  };
  EXPECT_EQ(load_model(npz(model_arrays())).steps(), 3);
  for (const std::string name : {"A", "B", "C", "D", "G", "state_dim"})
    expect_words(error_with(name, std::nullopt), {"'" + name + "'", "found", "needed"});
  expect_words(error_with("A", ramp({3, 2})), {"'A'", "(3, 2)", "three dimensions"});
  expect_words(error_with("A", ramp({3, 2, 3})), {"'A'", "3 steps of 2 x 3", "3 steps of 2 x 2"});
  expect_words(error_with("B", ramp({2, 2, 1})), {"'B'", "2 steps", "3 steps"});
  expect_words(error_with("C", ramp({3, 1, 3})), {"'C'", "1 x 3", "1 x 2"});
  expect_words(error_with("D", ramp({3, 2, 1})), {"'D'", "2 x 1", "1 x 1"});
  expect_words(error_with("A", numbers({3, 2, 2}, missing)), {"A[0]", "not finite"});
  expect_words(error_with("A", texts({3, 2, 2})), {"'A'", "text found"});
  expect_words(error_with("state_dim", numbers({3})), {"'state_dim'", "(3)", "(4)"});
  expect_words(error_with("state_dim", numbers({4}, 3)), {"'state_dim'", "3 found", "from 0 to 2"});
  expect_words(error_with("state_dim", numbers({4}, -1)), {"'state_dim'", "-1 found"});
  expect_words(error_with("state_dim", numbers({4}, 1.5)), {"'state_dim'", "1.5 found"});
  expect_words(error_with("state_dim", numbers({4}, 1e300)), {"'state_dim'", "1e+300 found"});
  expect_words(error_with("k_begin", numbers({}, 0.5)), {"'k_begin'", "0.5 found"});
  expect_words(error_with("k_begin", numbers({}, -1)), {"first step -1"});
  expect_words(error_with("dt", numbers({}, -1)), {"dt", "-1"});
  expect_words(error_with("rank", numbers({2})), {"'rank'", "(2)", "(3)"});
  expect_words(error_with("singular_values", ramp({2, 2})), {"'singular_values'", "(2, 2)"});
  expect_words(error_with("Q", ramp({3, 1, 1})), {"'Q'", "1 x 1", "2 x 2"});
  expect_words(error_with("x0_mean", ramp({3})), {"'x0_mean'", "(3)", "(2)"});
  expect_words(error_with("x0_cov", ramp({2, 3})), {"x0_cov", "2 x 3", "2 x 2"});
  expect_words(error_with("u_nominal", ramp({3, 2})), {"u_nominal", "3 x 2"});
}

TEST_F(Shapes, EnsemblesAndModelsAreToldApart) {
  const auto path = npz(model_arrays());
  expect_load_error(path, {"a model found", "an ensemble", "needed"});
  const auto ensemble = mat({{"u", ramp({2, 5, 1})}, {"y", ramp({2, 5, 1})}});
  expect_words(error_of([&] { load_model(ensemble); }), {"an ensemble found", "a model", "needed"});
  const auto other = npz({{"voltage", ramp({2, 5, 1})}, {"weather", texts({3})}});
  expect_load_error(other, {"'u'", "'voltage'", "'weather'"});
  expect_words(error_of([&] { file_kind(other); }), {"neither", "'voltage'", "'weather'"});
}

TEST_F(Io, ModelInMatlabHasTheStepLast) {
  Random random(3);
  const Model model = random_model(random, 4, 3, 2, 1, false);
  save_model(model, file("m.mat"));
  const io::Contents contents = io::read_mat(file("m.mat"), {"A", "B"});
  for (const auto& [name, array] : contents.arrays)
    EXPECT_EQ(array.shape,
              (Shape{static_cast<size_t>(model.states()), name == "A" ? static_cast<size_t>(model.states()) : 2, 4}));
}

// ---- files that are none ----

TEST_P(EveryFormat, NoFileNoDirectoryNoEmptyFile) {
  expect_load_error(target(), {"no such file"});
  fs::create_directory(target());
  expect_load_error(target(), {"directory"});
  fs::remove(target());
  write_bytes(target(), "");
  expect_load_error(target(), {"empty"});
  expect_words(error_of([&] { file_kind(file("none.npz")); }), {"none.npz: no such file"});
  expect_words(error_of([&] { load_model(file("none.npz")); }), {"none.npz: no such file"});
}

TEST_P(EveryFormat, OtherContentIsRefused) {
  for (const std::string& content :
       {std::string("hello, world\n"), std::string("\0\0\0\0", 4), std::string(5000, '\xFF'),
        std::string("PK\x03\x04 no archive"), std::string("\x89HDF\r\n\x1a\n no more")}) {
    write_bytes(target(), content);
    expect_load_error(target(), {"found"});
  }
}

TEST_F(Io, UnknownExtensions) {
  write_bytes(file("a.xlsx"), "x");
  expect_load_error(file("a.xlsx"), {"'.xlsx'", ".npz", ".h5", ".mat", ".csv"});
  Random random(1);
  const Ensemble e = random_ensemble(random, 1, 2, 1, 1);
  expect_words(error_of([&] { save_ensemble(e, file("b.txt")); }), {"'.txt'", ".npz"});
  expect_words(error_of([&] { save_ensemble(e, file("b")); }), {"''", ".npz"});
  expect_words(error_of([&] { save_model(random_model(random, 1, 1, 1, 1, false), file("m.csv")); }), {".csv", ".npz"});
  expect_words(error_of([&] { load_model(file("a.xlsx")); }), {"'.xlsx'"});
  EXPECT_EQ(number_of_files(), 1u);
  save_ensemble(e, file("UPPER.NPZ"));
  expect_same(load_ensemble(file("UPPER.NPZ")), e);
}

TEST_P(BinaryFormat, TruncatedFilesAreRefused) {
  Random random(5);
  Ensemble e = random_ensemble(random, 3, 6, 2, 2);
  shorten(random, e);
  save_ensemble(e, target(), options());
  const std::string bytes = bytes_of(target());
  const size_t step = std::max<size_t>(1, bytes.size() / 300);
  for (size_t size = 1; size < bytes.size(); size += step) {
    SCOPED_TRACE(size);
    write_bytes(target(), bytes.substr(0, size));
    error_of([&] { load_ensemble(target()); });
    if (Test::HasFailure()) break;
  }
}

TEST_P(BinaryFormat, TruncatedModelsAreRefused) {
  Random random(5);
  save_model(random_model(random, 4, 2, 1, 2, true), target(), options());
  const std::string bytes = bytes_of(target());
  const size_t step = std::max<size_t>(1, bytes.size() / 200);
  for (size_t size = 1; size < bytes.size(); size += step) {
    SCOPED_TRACE(size);
    write_bytes(target(), bytes.substr(0, size));
    error_of([&] { load_model(target()); });
    if (Test::HasFailure()) break;
  }
}

// Whatever the bytes are: an answer or an IoError.
TEST_P(EveryFormat, DamagedFilesNeverCrash) {
  Random random(11);
  Ensemble e = random_ensemble(random, 2, 3, 1, 2);
  e.names = odd_channels(1, 2);
  save_ensemble(e, target(), options());
  const std::string bytes = bytes_of(target());
  const fs::path damaged = file(std::string("damaged") + GetParam().extension);
  const char* rounds = std::getenv("TOKID_FUZZ_ROUNDS");
  const int count = rounds ? std::stoi(rounds) : 300;
  for (int round = 0; round < count; ++round) {
    std::string copy = bytes;
    for (Index flips = between(random, 1, 3); flips > 0; --flips) {
      const size_t at = random() % (coin(random) ? std::min<size_t>(copy.size(), 256) : copy.size());
      copy[at] = coin(random) ? static_cast<char>(copy[at] ^ (1 << random() % 8)) : static_cast<char>(random());
    }
    write_bytes(damaged, copy);
    try {
      load_ensemble(damaged);
    } catch (const IoError&) {
    }
  }
}

// ---- sizes that can't be ----

// An archive of raw .npy files.
void write_raw_npz(const fs::path& path, const std::vector<std::pair<std::string, std::string>>& entries) {
  int code = 0;
  zip_t* archive = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
  ASSERT_NE(archive, nullptr);
  for (const auto& [name, bytes] : entries)
    ASSERT_GE(zip_file_add(archive, name.c_str(), zip_source_buffer(archive, bytes.data(), bytes.size(), 0), 0), 0);
  ASSERT_EQ(zip_close(archive), 0);
}

std::string npy(const std::string& header, size_t payload, char version = 1) {
  std::string bytes = "\x93NUMPY";
  bytes += {version, '\0', static_cast<char>(header.size()), '\0'};
  if (version > 1) bytes += std::string(2, '\0');
  return bytes + header + std::string(payload, '\0');
}

TEST_F(Io, NpyHeaders) {
  const std::string good = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3, 1), }", 48);
  const auto error_for = [&](const std::string& u) {
    write_raw_npz(file("a.npz"), {{"u.npy", u}, {"y.npy", good}});
    return error_of([&] { load_ensemble(file("a.npz")); });
  };
  const auto loads = [&](const std::string& u) {
    write_raw_npz(file("a.npz"), {{"u.npy", u}, {"y.npy", good}});
    return load_ensemble(file("a.npz")).experiments() == 2;
  };
  EXPECT_TRUE(loads(good));
  EXPECT_TRUE(loads(npy("{'shape': (2,3,1), 'fortran_order': True,\n 'descr': \"<f4\"}  \n", 24, 2)));
  EXPECT_TRUE(loads(npy("{'descr': '>i2', 'fortran_order': False, 'shape': (2L, 3L, 1L)}", 12, 3)));
  EXPECT_TRUE(loads(npy("{'descr': '|b1', 'fortran_order': False, 'shape': (2, 3, 1)}", 6)));

  expect_words(error_for(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3, 1), }", 40)),
               {"'u'", "40", "48"});
  expect_words(error_for(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3, 1), }", 56)),
               {"'u'", "56", "48"});
  expect_words(error_for(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387904, 3, 1), }", 48)),
               {"memory"});
  expect_words(error_for(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 1), }", 48)),
               {"'u'", "48"});
  expect_words(error_for(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999, 1), }", 48)),
               {"'u'", "header"});
  expect_words(error_for(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-2, 3, 1), }", 48)),
               {"'u'", "header"});
  expect_words(error_for(npy("{'descr': '<U0', 'fortran_order': False, 'shape': (1000000000000, 1), }", 0)),
               {"'u'", "0 bytes found"});
  expect_words(error_for(npy("{'descr': '<c16', 'fortran_order': False, 'shape': (2, 3, 1), }", 96)),
               {"'u'", "complex"});
  expect_words(error_for(npy("{'descr': '|O', 'fortran_order': False, 'shape': (2, 3, 1), }", 96)),
               {"'u'", "Python objects"});
  expect_words(error_for(npy("{'descr': '<M8[ns]', 'fortran_order': False, 'shape': (2, 3, 1), }", 48)),
               {"'u'", "dates"});
  expect_words(error_for(npy("{'descr': '<f2', 'fortran_order': False, 'shape': (2, 3, 1), }", 12)), {"'u'", "<f2"});
  expect_words(error_for(npy("{'descr': [('a', '<f8'), ('b', '<f8')], 'fortran_order': False, 'shape': (2, 3), }", 96)),
               {"'u'", "records"});
  expect_words(error_for(npy("{'descr': '<f8', 'shape': (2, 3, 1), }", 48)), {"'u'", "header"});
  expect_words(error_for(npy("{", 48)), {"'u'", "header"});
  expect_words(error_for(npy("{}", 48, 9)), {"'u'", "header"});
  expect_words(error_for("\x93NUM"), {"'u'", "header"});
  expect_words(error_for(std::string("\x93NUMPY\x01\x00\xff\xff", 10)), {"'u'", "truncated"});
}

TEST_F(Io, FalseChecksumIsNoticed) {
  Random random(1);
  save_ensemble(random_ensemble(random, 3, 20, 1, 1), file("a.npz"));
  std::string bytes = bytes_of(file("a.npz"));
  bytes[bytes.find("NUMPY", bytes.find("u.npy")) + 300] ^= 1;
  write_bytes(file("a.npz"), bytes);
  expect_load_error(file("a.npz"), {"'u'", "CRC"});
}

// ---- CSV ----

class Csv : public Io {
 protected:
  fs::path csv(const std::string& text) const { return write_bytes(file("a.csv"), text), file("a.csv"); }
  Ensemble load(const std::string& text, const ReadOptions& options = {}) const {
    return load_ensemble(csv(text), options);
  }
  void expect_error(const std::string& text, const std::vector<std::string>& words,
                    const ReadOptions& options = {}) const {
    expect_load_error(csv(text), words, options);
  }
};

TEST_F(Csv, TidyRowsInAnyOrder) {
  const Ensemble e = load(
      "experiment,time,remark,u_force,y_x,y_v\n"
      "b,0.2,,3,30,300\r\n"
      "a,0.1,\"many, many\nlines\",2,20,\n"
      "\n"
      "b,0.1,x,5,50,NaN\n");
  EXPECT_EQ(e.experiments(), 2);
  EXPECT_EQ(e.steps(), 2);
  EXPECT_NEAR(e.dt, 0.1, 1e-15);
  EXPECT_EQ(e.u(0, 1, 0), 3);  // b appears first
  EXPECT_EQ(e.y(0, 0, 0), 50);
  EXPECT_EQ(e.u(1, 0, 0), 2);
  EXPECT_TRUE(std::isnan(e.u(1, 1, 0)));
  EXPECT_TRUE(std::isnan(e.y(1, 0, 1)));
  EXPECT_EQ(e.names.input_names, std::vector<std::string>{"u_force"});
}

TEST_F(Csv, StepsInsteadOfTime) {
  const Ensemble e = load("k,experiment,u,y\n10,1,1,2\n12,1,3,4\n11,2,5,6\n");
  EXPECT_EQ(e.experiments(), 2);
  EXPECT_EQ(e.steps(), 3);
  EXPECT_EQ(e.dt, 1.0);
  EXPECT_EQ(e.y(1, 1, 0), 6);
  expect_error("k,u,y\n0,1,2\n0.5,1,2\n", {"line 3", "'k'", "'0.5'", "whole number"});
}

TEST_F(Csv, NeitherStepsNorTime) {
  const Ensemble e = load("\n# dt = 0.5\n\n# a remark\nu,y\n1,2\n3,4\n5,6\n");
  EXPECT_EQ(e.experiments(), 1);
  EXPECT_EQ(e.steps(), 3);
  EXPECT_EQ(e.dt, 0.5);
  EXPECT_EQ(e.y(0, 2, 0), 6);
  ASSERT_EQ(e.remarks.size(), 1u);
  expect_words(e.remarks.front(), {"successive steps", "'time'", "'k'"});
}

TEST_F(Csv, NotesAreFlat) {
  const std::string rows = "k,u,y\n0,1,2\n";
  for (const std::string& note : {std::string("[[1]]"), std::string("{\"a\": 1}"), "[" + std::string(500, '1') + "}"})
    for (const char* name : {"dt", "length", "input_names"}) {
      const std::string message = error_of([&] { load(fmt::format("# {} = {}\n{}", name, note, rows)); });
      expect_words(message, {"line 1", name, note.substr(0, 80), "JSON"});
      EXPECT_LT(message.size(), 2 * file("a.csv").string().size() + 250);  // twice the name of the file
    }
  EXPECT_EQ(load("# length = [1,2]\n# length = [1, 2]\nexperiment,k,u,y\n0,0,1,2\n1,0,1,2\n1,1,1,2\n").length.size(),
            2u);
}

TEST_F(Csv, ChecksumOfTheRest) {
  const std::string rest = "# dt = 0.1\nexperiment,time,u,y\n0,0,1,2\n0,0.1,3,4\n";
  io::TextChecksum checksum;
  checksum.add(rest);
  const std::string first = "# checksum = " + checksum.digits() + "\n";
  const auto said = [&](const std::string& text) { return load(text).remarks; };
  const auto with_returns = [](std::string text) {
    for (size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.insert(at, 1, '\r');
    return text;
  };
  for (const std::string& text : {rest, first + rest, with_returns(first + rest), "\xEF\xBB\xBF" + first + rest})
    EXPECT_TRUE(said(text).empty()) << text;
  std::string other = rest;
  other.replace(other.find(",4\n"), 3, ",5\n");
  for (const std::string& text :
       {first + other, "# checksum = 12\n" + rest, "# checksum = \n" + rest, "# checksun = " + first.substr(13) + rest,
        first + rest + "0,0.2,5,6\n", first + "\n" + rest}) {
    ASSERT_EQ(said(text).size(), 1u) << text;
    expect_words(said(text).front(), {file("a.csv").string(), "changed after tokid wrote it", "by hand", "damaged"});
  }
  // What is written is read without a word, and so is what editors make of its line ends.
  Random random(1);
  Ensemble e = random_ensemble(random, 3, 4, 1, 2);
  e.dt = 0.5;
  e.names.input_names = {"of two\r\nlines"};
  save_ensemble(e, file("b.csv"));
  const std::string written = bytes_of(file("b.csv"));
  EXPECT_TRUE(said(written).empty());
  EXPECT_TRUE(
      said(with_returns(written.substr(0, written.find('\n') + 1)) + written.substr(written.find('\n') + 1)).empty());
}

TEST(TextChecksum, KnowsNoPiecesAndNoReturnsBeforeNewLines) {
  std::mt19937_64 random(3);
  const auto checksum = [&](std::string_view text, bool in_pieces) {
    io::TextChecksum sum;
    while (!text.empty()) {
      const size_t size = in_pieces ? 1 + random() % text.size() : text.size();
      sum.add(text.substr(0, size));
      text.remove_prefix(size);
    }
    return sum.digits();
  };
  for (int i = 0; i < 200; ++i) {
    std::string text, other;
    const std::string_view letters[] = {"a", "1", "\r", "\n", ","};
    for (int c = 0; c < 12; ++c) {
      const std::string_view letter = letters[random() % 5];
      // Returns that stand alone count.
      if (letter == "\n" && text.ends_with('\r')) continue;
      text += letter;
      other += letter == "\n" ? "\r\n" : letter;
    }
    EXPECT_EQ(checksum(text, true), checksum(text, false));
    EXPECT_EQ(checksum(text, true), checksum(other, true)) << text;
    EXPECT_EQ(checksum(text, false).size(), 16u);
    EXPECT_NE(checksum(text, false), checksum(text + "\r", false));
  }
}

TEST_F(Csv, ChannelsByName) {
  const std::string text = "# input_names = [\"a\"]\n# input_units = [\"V\"]\ntime,a,b,y\n0,1,2,3\n1,4,5,6\n";
  EXPECT_EQ(load(text).names.input_units, std::vector<std::string>{"V"});
  const Ensemble e = load(text, {{"y", "a"}, {"b"}, true});
  EXPECT_EQ(e.u(0, 1, 0), 6);
  EXPECT_EQ(e.names.input_names, (std::vector<std::string>{"y", "a"}));
  EXPECT_EQ(e.names.input_units, (std::vector<std::string>{"", "V"}));
  EXPECT_EQ(e.names.output_names, std::vector<std::string>{"b"});
  expect_error(text, {"'c'", "'time', 'a', 'b', 'y'"}, {{"c"}, {"y"}, true});
  expect_error(text, {"'a'", "as an output"}, {{"a"}, {"a"}, true});
  expect_error("time,u,u,y\n0,1,2,3\n", {"header", "two columns 'u'"});
  expect_error("time,a,y\n0,1,2\n", {"begins with u", "'time', 'a', 'y'"});
  expect_error("time,u,b\n0,1,2\n", {"begins with y", "'time', 'u', 'b'"});
  EXPECT_EQ(load("time,u,b\n0,1,2\n", {{}, {}, false}).outputs(), 0);
}

TEST_F(Csv, ColumnsAreChosenInCsvOnly) {
  Random random(1);
  save_ensemble(random_ensemble(random, 1, 2, 1, 1), file("a.npz"));
  expect_load_error(file("a.npz"), {".csv files only"}, {{"u1"}, {}, true});
}

TEST_F(Csv, LinesAndColumnsOfErrors) {
  expect_error("time,u,y\n0,1,2\n1,1\n", {"line 3", "2 cells found, 3 needed"});
  expect_error("time,u,y\n0,1,2\n1,1,2,3\n", {"line 3", "4 cells found, 3 needed"});
  expect_error("time,u,y\n0,1,2\n\n1,x7,2\n", {"line 4", "'u'", "'x7'", "number"});
  expect_error("time,u,y\n0,1,2\n1,1e999,2\n", {"line 3", "'u'", "'1e999'"});
  expect_error("time,u,y\n0,1,2\n,1,2\n", {"line 3", "'time'"});
  expect_error("experiment,time,u,y\n,0,1,2\n", {"line 2", "'experiment'"});
  expect_error("time,u,y\n0,1,2\n1,\"1\"2,2\n", {"line 3", "quotation mark"});
  expect_error("time,u,y\n0,1,2\n1,\"1,2\n3,4,5\n", {"line 4", "quot"});
  expect_error("time,u,y\n0,1,2\n0,1,2\n", {"line 3", "second row", "step 0"});
  expect_error("time,u,y\n0,1,2\n1,1,2\n2.1,1,2\n", {"'time'", "even steps"});
  expect_error("time,u,y\n0,1,2\n1,1,inf\n", {"infinite", "experiment 0", "step 1", "y"});
  expect_error("time,u,y\n0,1,\n1,1,\n", {"y", "missing"});
  expect_error("time,u,y\n", {"no rows"});
  expect_error("# dt = 1\n", {"no header"});
  expect_error("# dt = fast\ntime,u,y\n0,1,2\n", {"line 1", "dt", "'fast'"});
  expect_error("# dt = -1\ntime,u,y\n0,1,2\n", {"dt", "-1"});
  expect_error("# input_names = u\ntime,u,y\n0,1,2\n", {"line 1", "input_names", "JSON"});
  expect_error("# length = [3]\ntime,u,y\n0,1,2\n", {"length", "3"});
  expect_error("# length = [-3]\ntime,u,y\n0,1,2\n", {"length", "-3"});
  expect_error("# initial_state = hot\ntime,u,y\n0,1,2\n", {"initial_state", "hot"});
  expect_error("k,u,y\n0,1,2\n9000000000000000,1,2\n", {"steps", "2 rows"});
  expect_error("time,u,y\n0,1,2\n1e-3,1,2\n1e300,1,2\n", {"line 3"});
}

TEST_F(Csv, TimeGrids) {
  // Printed with rounding errors, from an offset, with gaps that are meant, as the sample time is stated.
  std::string text = "experiment,time,u,y\n";
  for (int n = 0; n < 3; ++n)
    for (int k = n; k < 100; k += n + 1)
      text += std::to_string(n) + "," + std::to_string(1000.0 + k * 0.05) + ",1," + std::to_string(k) + "\n";
  expect_words(error_of([&] { load(text); }), {"steps of 0.1 s in experiment '1'", "'# dt = 0.05'"});
  const Ensemble e = load("# dt = 0.05\n" + text);
  EXPECT_EQ(e.steps(), 100);
  EXPECT_NEAR(e.dt, 0.05, 1e-12);
  for (Index n = 0; n < 3; ++n)
    for (Index k = n; k < 100; k += n + 1) EXPECT_EQ(e.y(n, k, 0), static_cast<double>(k));
  // The clock of the computer as the time.
  EXPECT_NEAR(load("time,u,y\n1700000000.01,1,2\n1700000000.02,1,2\n1700000000.03,1,2\n1700000000.05,1,2\n").dt, 0.01,
              1e-7);
}

// Experiments that begin at `begin`, with steps of dt, as `text` writes the times.
std::string table(const std::vector<double>& begin, double dt, const std::function<std::string(double)>& text,
                  Index steps = 60) {
  std::string result = "experiment,time,u,y\n";
  for (size_t n = 0; n < begin.size(); ++n)
    for (Index k = 0; k < steps; ++k)
      result += fmt::format("{},{},1,{}\n", char('a' + n), text(begin[n] + double(k) * dt), k);
  return result;
}

TEST_F(Csv, TimesThatWereAddedUp) {
  std::string text = "time,u,y\n";
  double time = 0.0;
  for (Index k = 0; k < 2000; ++k, time += 0.1) text += fmt::format("{},1,{}\n", time, k);
  const Ensemble e = load(text);
  EXPECT_EQ(e.steps(), 2000);
  EXPECT_EQ(e.dt, 0.1);
}

TEST_F(Csv, OneWildTimeIsTold) {
  const auto text = [](double t) { return fmt::format("{:.10g}", t); };
  const std::string ten = table({0.0}, 0.1, text, 10), two = table({0.0, 0.0}, 0.1, text, 10);
  expect_error(ten + "a,77.77,1,2\n", {"line 12", "77.77 found", "steps of 0.1"});
  expect_error(two + "b,77.77000001,1,2\n", {"line 22", "77.77000001 found", "steps of 0.1"});
  expect_error("# dt = 0.1\n" + ten + "a,77.77,1,2\n", {"line 13", "77.77 found"});
  expect_error("# dt = 0.05\n" + ten, {"'# dt = 0.05'", "multiples of 0.1"});
  expect_error(table({0.0, 0.05}, 0.1, text), {"line 62", "0.05 found", "steps of 0.1"});
  EXPECT_EQ(load("# dt = 0.05\n" + table({0.0, 0.05}, 0.1, text)).dt, 0.05);
  EXPECT_EQ(load(table({0.0, 0.3}, 0.1, text)).steps(), 63);
}

TEST_F(Csv, ByteOrderMarkAndBlanks) {
  const Ensemble e = load("\xEF\xBB\xBFtime, u , y\n0, 1 ,+2\n1,3,4");
  EXPECT_EQ(e.y(0, 0, 0), 2);
  EXPECT_EQ(e.y(0, 1, 0), 4);
}

TEST_F(Csv, LabelsOfExperimentsAreTheirNames) {
  std::string text = "experiment,time,u1,y1\n";
  for (const int n : {3, 1, 17})
    for (int k = 0; k < 2; ++k) text += fmt::format("{},{},{},{}\n", n, k, n + 0.5, n == 17 && k == 1 ? "inf" : "1");
  write_bytes(file("a.csv"), text);
  expect_load_error(file("a.csv"), {"output y1: infinite value in experiment \"17\" (row 2) at step 1"});
  text.replace(text.find("inf"), 3, "2");
  write_bytes(file("a.csv"), text);
  const Ensemble e = load_ensemble(file("a.csv"));
  EXPECT_EQ(e.experiment_names, (std::vector<std::string>{"3", "1", "17"}));
  EXPECT_EQ(e.u(2, 0, 0), 17.5);
  // Through another format and back, the file is the same.
  save_ensemble(e, file("b.csv"));
  save_ensemble(e, file("c.npz"));
  save_ensemble(load_ensemble(file("c.npz")), file("d.csv"));
  EXPECT_EQ(bytes_of(file("b.csv")), bytes_of(file("d.csv")));
  EXPECT_NE(bytes_of(file("b.csv")).find("\n17,0,"), std::string::npos);
}

TEST_F(Csv, RowNumbersAreNoNames) {
  write_bytes(file("a.csv"), "experiment,time,u1,y1\n0,0,1,2\n1,0,3,4\n");
  EXPECT_TRUE(load_ensemble(file("a.csv")).experiment_names.empty());
  write_bytes(file("a.csv"), "time,u1,y1\n0,1,2\n1,3,4\n");
  EXPECT_TRUE(load_ensemble(file("a.csv")).experiment_names.empty());
}

TEST_F(Csv, NamesOfExperimentsAreNoFormulas) {
  Random random(1);
  Ensemble e = random_ensemble(random, 2, 3, 1, 1);
  e.experiment_names = {"=cmd|' /C calc'!A0", "b"};
  expect_words(error_of([&] { save_ensemble(e, file("a.csv")); }), {"a.csv", "experiment_names", "=cmd", "formula"});
  e.experiment_names = {"-5", "#b"};
  save_ensemble(e, file("a.csv"));
  EXPECT_EQ(load_ensemble(file("a.csv")).experiment_names, e.experiment_names);
}

TEST_F(Csv, NothingIsDroppedSilently) {
  Random random(1);
  Ensemble e = random_ensemble(random, 2, 3, 1, 1);
  add_free_response(random, e);
  expect_words(error_of([&] { save_ensemble(e, file("a.csv")); }), {"a.csv", "free responses", ".npz"});
  e = random_ensemble(random, 2, 3, 1, 1);
  e.names.input_names = {"time"};
  expect_words(error_of([&] { save_ensemble(e, file("a.csv")); }), {"a.csv", "'time'"});
  e.names.input_names = {"y1"};
  expect_words(error_of([&] { save_ensemble(e, file("a.csv")); }), {"a.csv", "'y1'"});
  EXPECT_EQ(number_of_files(), 0u);
}

// ---- writing ----

TEST_P(EveryFormat, PermissionsFollowTheUmask) {
  Random random(1);
  const mode_t before = umask(027);
  save_ensemble(random_ensemble(random, 1, 2, 1, 1), target(), options());
  umask(before);
  struct stat status {};
  ASSERT_EQ(stat(target().c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0640u);
}

TEST_P(EveryFormat, FailuresLeaveNothingBehind) {
  Random random(1);
  const Ensemble e = random_ensemble(random, 1, 2, 1, 1);
  const std::string name = target().filename().string();
  const fs::path nowhere = file("none") / name;
  expect_words(error_of([&] { save_ensemble(e, nowhere, options()); }),
               {nowhere.string(), "No such file or directory"});
  EXPECT_EQ(number_of_files(), 0u);
  fs::create_directory(target());
  expect_words(error_of([&] { save_ensemble(e, target(), options()); }), {"directory"});
  EXPECT_EQ(number_of_files(), 1u);
}

TEST_P(EveryFormat, FullDiskLeavesTheOldFile) {
  Random random(1);
  const Ensemble old = random_ensemble(random, 1, 2, 1, 1);
  save_ensemble(old, target(), options());
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  rlimit small = before;
  small.rlim_cur = 20000;
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &small);
  int reason = 0;
  const std::string message = error_of([&] {
    try {
      save_ensemble(random_ensemble(random, 40, 100, 2, 2), target(), options());
    } catch (const WriteError& error) {
      reason = error.error();
      throw;
    }
  });
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  expect_words(message, {target().string(), "written", "File too large"});
  EXPECT_EQ(reason, EFBIG);
  EXPECT_EQ(number_of_files(), 1u);
  expect_same(load_ensemble(target()), old);
}

TEST_F(Io, FilesTogetherAppearWhenAllAreWritten) {
  Random random(1);
  const Ensemble first = random_ensemble(random, 1, 2, 1, 1), second = random_ensemble(random, 2, 3, 1, 1);
  save_ensemble(first, file("a.npz"));
  const auto save_both = [&] {
    save_ensemble(second, file("a.npz"));
    save_ensemble(second, file("b.h5"));
    expect_same(load_ensemble(file("a.npz")), first);
    EXPECT_FALSE(fs::exists(file("b.h5")));
  };
  {
    const FilesTogether files;
    save_both();
  }
  EXPECT_EQ(number_of_files(), 1u);
  FilesTogether files;
  save_both();
  files.commit();
  EXPECT_EQ(number_of_files(), 2u);
  for (const char* name : {"a.npz", "b.h5"}) expect_same(load_ensemble(file(name)), second);
}

TEST_P(EveryFormat, UnwritableDirectory) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  Random random(1);
  fs::permissions(target().parent_path(), fs::perms::owner_read | fs::perms::owner_exec);
  expect_words(error_of([&] { save_ensemble(random_ensemble(random, 1, 2, 1, 1), target(), options()); }),
               {target().string(), "Permission denied"});
}

TEST_P(EveryFormat, TextThatNoFormatCanStore) {
  Random random(1);
  Ensemble e = random_ensemble(random, 1, 2, 1, 1);
  for (const std::string& name : {std::string("a\0b", 3), std::string("\xFF\xFE"), std::string("\xED\xA0\x80")}) {
    e.names.input_names = {name};
    expect_words(error_of([&] { save_ensemble(e, target(), options()); }), {"'input_names'", "UTF-8"});
  }
  EXPECT_EQ(number_of_files(), 0u);
}

TEST_F(Io, LinksAreFollowed) {
  Random random(1);
  const Ensemble e = random_ensemble(random, 1, 2, 1, 1);
  fs::create_directory(file("there"));
  save_ensemble(e, file("there") / "a.npz");
  fs::create_symlink(file("there") / "a.npz", file("link.npz"));
  save_ensemble(random_ensemble(random, 2, 2, 1, 1), file("link.npz"));
  EXPECT_TRUE(fs::is_symlink(file("link.npz")));
  EXPECT_EQ(load_ensemble(file("there") / "a.npz").experiments(), 2);
  // Also to where nothing is yet, from link to link.
  fs::create_symlink("there/b.npz", file("first.npz"));
  fs::create_symlink("first.npz", file("second.npz"));
  save_ensemble(e, file("second.npz"));
  EXPECT_TRUE(fs::is_symlink(file("second.npz")) && fs::is_symlink(file("first.npz")));
  EXPECT_EQ(load_ensemble(file("there") / "b.npz").experiments(), 1);
  fs::create_symlink("/dev/null", file("null.npz"));
  expect_words(error_of([&] { save_ensemble(e, file("null.npz")); }), {"null.npz", "a device found"});
  fs::create_symlink("round.npz", file("round.npz"));
  expect_words(error_of([&] { save_ensemble(e, file("round.npz")); }), {"round.npz", "symbolic links"});
}

TEST_P(EveryFormat, TheGroupStays) {
  Random random(1);
  save_ensemble(random_ensemble(random, 1, 2, 1, 1), target(), options());
  std::vector<gid_t> groups(size_t(std::max(0, getgroups(0, nullptr))));
  groups.resize(size_t(std::max(0, getgroups(int(groups.size()), groups.data()))));
  std::erase(groups, getegid());
  if (groups.empty() && geteuid() != 0) GTEST_SKIP() << "no other group to belong to";
  const gid_t group = groups.empty() ? 4 : groups.front();
  ASSERT_EQ(chown(target().c_str(), uid_t(-1), group), 0);
  ASSERT_EQ(chmod(target().c_str(), 0640), 0);
  save_ensemble(random_ensemble(random, 2, 2, 1, 1), target(), options());
  struct stat status {};
  ASSERT_EQ(stat(target().c_str(), &status), 0);
  EXPECT_EQ(status.st_gid, group);
  EXPECT_EQ(status.st_mode & 0777, 0640u);
}

TEST_P(EveryFormat, PermissionsStay) {
  Random random(1);
  const auto mode = [&] { return fs::status(target()).permissions(); };
  save_ensemble(random_ensemble(random, 1, 2, 1, 1), target(), options());
  for (const fs::perms kept : {fs::perms(0600), fs::perms(0664), fs::perms(0200)}) {
    fs::permissions(target(), kept);
    save_ensemble(random_ensemble(random, 1, 2, 1, 1), target(), options());
    EXPECT_EQ(mode(), kept);
  }
}

TEST_F(Io, MemoryOfControlGroups) {
  const auto write = [&](const std::string& path, const std::string& text) {
    fs::create_directories(file(path).parent_path());
    write_bytes(file(path), text);
  };
  constexpr auto none = std::numeric_limits<std::uint64_t>::max();
  EXPECT_EQ(io::group_memory(file("")), none);
  write("proc/self/cgroup", "0::/user.slice/job.scope\n");
  write("sys/fs/cgroup/user.slice/job.scope/memory.max", "max\n");
  EXPECT_EQ(io::group_memory(file("")), none);
  write("sys/fs/cgroup/user.slice/memory.max", "3000000\n");
  EXPECT_EQ(io::group_memory(file("")), 3000000u);
  write("sys/fs/cgroup/user.slice/job.scope/memory.max", "2000000\n");
  EXPECT_EQ(io::group_memory(file("")), 2000000u);
  write("sys/fs/cgroup/memory.max", "1000000\n");
  EXPECT_EQ(io::group_memory(file("")), 1000000u);
  write("proc/self/cgroup", "7:cpu,cpuacct:/other\n4:memory:/docker/a:b\n0::/\n");
  write("sys/fs/cgroup/memory/other/memory.limit_in_bytes", "1\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  write("sys/fs/cgroup/memory/docker/a:b/memory.limit_in_bytes", "500000\n");
  EXPECT_EQ(io::group_memory(file("")), 500000u);
}

TEST_P(EveryFormat, NoFileForAnInconsistentEnsemble) {
  Random random(1);
  const Ensemble good = random_ensemble(random, 2, 3, 1, 2);
  const auto error_with = [&](const std::function<void(Ensemble&)>& change) {
    Ensemble e = good;
    change(e);
    return error_of([&] { save_ensemble(e, target(), options()); });
  };
  expect_words(error_with([](Ensemble& e) { e.length = {1}; }), {"length", "1 entries", "2 needed"});
  expect_words(error_with([](Ensemble& e) { e.names.output_units = {"m"}; }),
               {"output_units", "1 entries", "2 needed"});
  expect_words(error_with([](Ensemble& e) { e.free.experiments = 3; }), {"free_y", "(0, 0)"});
  expect_words(error_with([](Ensemble& e) { e.experiment_names = {"a"}; }), {"experiment_names", "1 name", "2 exp"});
  expect_words(error_with([](Ensemble& e) {
                 e.experiment_names = {"a", "a"};
               }),
               {"experiment_names", "\"a\" found at rows 0 and 1"});
  expect_words(error_with([](Ensemble& e) { e.experiment_names = {"a", "b\xFF"}; }), {"experiment_names", "UTF-8"});
  EXPECT_EQ(number_of_files(), 0u);
}

TEST_F(Io, NoFileForAnInconsistentModel) {
  Random random(1);
  Model model = random_model(random, 2, 2, 1, 1, false);
  model.step[1] = Step(2, 2, 1, 2);  // one output more
  EXPECT_THROW(save_model(model, file("m.npz")), std::invalid_argument);
  EXPECT_EQ(number_of_files(), 0u);
}

}  // namespace
}  // namespace tokid
