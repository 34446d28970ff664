// SPDX-License-Identifier: BSD-3-Clause
#include "common.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <limits>
#include <sstream>
#include <system_error>

#include "base/words.hpp"
#include "io/guard/atomic_file.hpp"
#include "tokid/printable.hpp"
#include "tool.hpp"

namespace tokid::app {

// Files

std::string extension_of(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

bool same_file(const fs::path& a, const fs::path& b) {
  if (a.empty() || b.empty()) return false;  // the option was not given
  std::error_code error;
  return fs::equivalent(a, b, error) ||
         fs::weakly_canonical(fs::absolute(a, error), error) == fs::weakly_canonical(fs::absolute(b, error), error);
}

namespace {

std::atomic<const char*> lock_file = nullptr;
static_assert(std::atomic<const char*>::is_always_lock_free);  // a handler of signals must not wait

void end_without_lock_file(int signal) {
  if (const char* name = lock_file.exchange(nullptr)) unlink(name);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

// The files of a folder or of a pattern. A path without any file stands for itself; its reader reports it.
std::vector<fs::path> files_of(const fs::path& path) {
  try {
    return data_files(path);
  } catch (const IoError&) {
    return {path};
  }
}

}  // namespace

HeldFile::HeldFile(const fs::path& path, double limit)
    : FileLock(path, {limit, [](const std::string& text) { message(text); }}) {
  static std::string name;  // the handlers of signals may read it until the process ends
  name = io::hidden_name(fs::absolute(io::resolved(path)), ".lock").string();
  lock_file = name.c_str();
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    if (std::signal(signal, end_without_lock_file) == SIG_IGN) std::signal(signal, SIG_IGN);  // as nohup needs it
}

HeldFile::~HeldFile() { lock_file = nullptr; }  // before FileLock releases the name, because others may then use it

void check_output(const fs::path& path, Content content, const std::vector<fs::path>& kept) {
  const auto refuse = [&path](const std::string& why) { throw IoError(fmt::format("{}: {}", path.string(), why)); };
  const std::string extension = extension_of(path);
  std::vector<std::string> known{".npz", ".h5", ".hdf5", ".mat"};
  if (content == Content::ensemble) known.emplace_back(".csv");
  if (content == Content::page) known = {".html", ".htm"};
  if (content == Content::table) known = {".csv"};
  if (content == Content::code) known = {".c", ".h"};
  if (std::find(known.begin(), known.end(), extension) == known.end())
    refuse(fmt::format("extension '{}' found, one of {} needed to write {}", extension, fmt::join(known, ", "),
                       content == Content::page         ? "a page"
                       : content == Content::table      ? "a table"
                       : content == Content::model      ? "a model"
                       : content == Content::bounds     ? "bounds"
                       : content == Content::state      ? "a state"
                       : content == Content::controller ? "a controller"
                       : content == Content::code       ? "C"
                                                        : "an ensemble"));

  std::error_code error;
  for (const fs::path& other : kept)
    for (const fs::path& file : files_of(other))
      if (same_file(path, file))
        refuse("another file of this command has this name, and writing would replace it. Use another name");
  if (fs::is_directory(path, error)) refuse("a directory found, the name of a file needed");
  if (error == std::errc::filename_too_long) refuse(fmt::format("can't be written: {}", error.message()));
  const fs::path directory = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(directory, error)) refuse(fmt::format("directory '{}' does not exist", directory.string()));
  const auto check_access = [&path](const fs::path& to, int mode, const std::string& what) {
    if (access(to.c_str(), mode) == 0) return;
    const int why = errno;
    throw WriteError(
        fmt::format("{}: {}can't be written: {}", path.string(), what, std::generic_category().message(why)), why);
  };
  check_access(directory, W_OK | X_OK, fmt::format("directory '{}' ", directory.string()));
  if (fs::exists(path, error)) check_access(path, W_OK, "");
}

Ensemble load_data(const Model& model, const fs::path& path, ReadOptions options) {
  return load_data(model, std::vector<fs::path>{path}, std::move(options));
}

Ensemble load_data(const Model& model, const std::vector<fs::path>& paths, ReadOptions options) {
  options.wanted = complete(model.names, model.inputs, model.outputs);
  return load_ensemble(paths, options);
}

Json json_of(const std::vector<fs::path>& paths) {
  if (paths.size() == 1) return paths.front().string();
  Json list = Json::array();
  for (const fs::path& path : paths) list.push_back(path.string());
  return list;
}

Ensemble load_reference(const Model& model, const fs::path& path, ReadOptions options) {
  options.outputs_required = false;  // a whole output may be free
  Ensemble wanted = load_data(model, path, options);
  if (wanted.experiments() != 1)
    throw std::invalid_argument(
        fmt::format("{}: {} found, one needed", path.string(), plural(wanted.experiments(), "experiment")));
  if (wanted.outputs() != model.outputs)
    throw std::invalid_argument(
        fmt::format("{}: outputs: {} found, the model has {}", path.string(), wanted.outputs(), model.outputs));
  return wanted;
}

std::string coverage(const Ensemble& computed) {
  std::vector<Index> steps;
  for (Index k = 0; k < computed.steps(); ++k) {
    const auto y = computed.output(k);
    if ((y.array() == y.array()).any()) steps.push_back(k);
  }
  if (steps.empty()) return "no outputs";
  const bool all = Index(steps.size()) == computed.steps();
  return fmt::format("outputs at steps {} to {}{}", steps.front(), steps.back(),
                     all ? "" : "; at all other steps they are missing (NaN)");
}

// Numbers

Index rank_deficient_steps(const Model& model) {
  Index count = 0;
  for (size_t s = 0; model.has(&Step::has_rank) && s < model.step.size(); ++s)
    if (model.step[s].rank() < unknowns(model, model.k_begin + Index(s))) ++count;
  return count;
}

double median(std::vector<double> values) {
  values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return std::isnan(v); }), values.end());
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Text

std::string number(double value) { return words::figure(value, 3); }

std::string share(double value) {
  if (std::isnan(value)) return "-";
  if (std::isinf(value)) return "infinite";
  return value < 10 ? number(100 * value) + " %" : number(value) + " times";
}
std::string percent(double fit) { return words::percent(fit, 1); }
std::string penalty(double smoothing) { return std::isinf(smoothing) ? "infinity" : number(smoothing); }

std::string plural(Index count, const char* noun) { return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s"); }

std::string describe(const Ensemble& e) { return describe(e.experiments(), e.steps(), e.inputs(), e.outputs(), e.dt); }

std::string describe(Index experiments, Index steps, Index inputs, Index outputs, double dt) {
  return fmt::format("N = {} experiments, T = {} steps, r = {} inputs, m = {} outputs, dt = {:.6g} s", experiments,
                     steps, inputs, outputs, dt);
}

std::string describe(const Model& model) {
  return fmt::format("n = {} states, r = {} inputs, m = {} outputs, steps {} to {}, dt = {:.6g} s", model.states(),
                     model.inputs, model.outputs, model.k_begin, model.k_end() - 1, model.dt);
}

namespace {

std::string with_unit(const std::string& name, const std::vector<std::string>& units, Index i) {
  const size_t at = static_cast<size_t>(i);
  return printable(at < units.size() && !units[at].empty() ? fmt::format("{} [{}]", name, units[at]) : name);
}

}  // namespace

std::string output_label(const Channels& names, Index j) { return with_unit(names.output(j), names.output_units, j); }
std::string input_label(const Channels& names, Index i) { return with_unit(names.input(i), names.input_units, i); }

// Output

Json json_penalty(double smoothing) { return std::isinf(smoothing) ? Json("infinity") : Json(smoothing); }
Json numbers(const Vector& values) { return Json(std::vector<double>(values.begin(), values.end())); }

void print(const std::string& text) {
  if (std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0) return;
  if (errno != EPIPE) throw std::system_error(errno, std::generic_category(), "standard output");
}

// NaN and infinity become null. Bytes that are not UTF-8 are replaced. If printable() would change a line, all
// characters beyond ASCII are written as \u and their number, which means the same in JSON.
void print(const Json& json) {
  const std::string text = text_of(json, 2);
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (printable(line) != line) return print(json.dump(2, ' ', true, Json::error_handler_t::replace) + '\n');
  print(text + '\n');
}

void warn(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) message("warning: " + warning);
}

void warn(const Findings& findings) { warn(in_words(findings)); }

void add_findings(Json& j, const Findings& findings) {
  j["findings"] = json_of(findings);
  j["warnings"] = in_words(findings);
}

Json json_of(const std::vector<OutlyingSamples>& outlying) {
  Json list = Json::array();
  for (const OutlyingSamples& o : outlying)
    list.push_back({{"experiment", o.experiment},
                    {"name", o.name.empty() ? Json() : Json(o.name)},
                    {"output", o.output},
                    {"steps", o.steps},
                    {"error", o.error},
                    {"usual", o.usual},
                    {"weight", o.weight}});
  return list;
}

namespace {

constexpr size_t bar_width = 20;
constexpr std::chrono::milliseconds interval{100};

// Columns of the terminal.
size_t columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

std::string duration(double seconds) {
  const long whole = std::lround(seconds);
  return whole < 100    ? fmt::format("{} s", whole)
         : whole < 6000 ? fmt::format("{} min", std::lround(seconds / 60))
                        : fmt::format("{:.1f} h", seconds / 3600);
}

void write(const std::string& text) { std::fwrite(text.data(), 1, text.size(), stderr); }
std::string blank() { return fmt::format("\r{:{}}\r", "", columns() - 1); }

}  // namespace

ProgressBar::ProgressBar(bool wanted) : enabled_(wanted && isatty(STDERR_FILENO) != 0) {
  if (enabled_) thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

ProgressBar::~ProgressBar() {
  if (!enabled_) return;
  thread_.request_stop();
  thread_.join();
  if (drawn_) write(blank());
}

Progress ProgressBar::callback() {
  if (!enabled_) return {};
  return [this](const ProgressReport& report) {
    const std::lock_guard lock(mutex_);
    report_ = report;
  };
}

void ProgressBar::note_after(std::chrono::seconds seconds, std::function<std::string()> text) {
  const std::lock_guard lock(mutex_);
  note_at_ = Clock::now() + seconds;
  note_ = std::move(text);
}

void ProgressBar::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, stop, interval, [&stop] { return stop.stop_requested(); })) {
    if (stop.stop_requested()) return;
    const ProgressReport report = report_;
    const bool noting = note_ && Clock::now() >= note_at_;
    const std::function<std::string()> note = noting ? std::exchange(note_, {}) : nullptr;
    lock.unlock();
    if (const std::string text = note ? note() : std::string(); !text.empty())
      write(blank() + wrapped(text, line_columns, "\n") + '\n');
    write(line(report));
    drawn_ = true;
    lock.lock();
  }
}

std::string ProgressBar::line(const ProgressReport& report) const {
  const auto done = static_cast<size_t>(report.share * bar_width);
  std::string text = fmt::format("[{}{}] {:3.0f} %  {}{}{}", std::string(done, '#'), std::string(bar_width - done, '.'),
                                 100 * report.share, report.stage, report.stage.empty() ? "" : ", ",
                                 duration(std::chrono::duration<double>(Clock::now() - begin_).count()));
  text.resize(columns() - 1, ' ');  // overwrites the line before
  return '\r' + text;
}

}  // namespace tokid::app
