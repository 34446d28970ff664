// SPDX-License-Identifier: BSD-3-Clause
#include "deploy/source.hpp"

#include <string_view>

namespace tokid::c_code {

namespace {

// Joins the parts whose condition holds.
struct Part {
  bool wanted;
  std::string_view text;
};
std::string joined(std::initializer_list<Part> parts, const Words& words) {
  std::string pattern;
  for (const Part& part : parts)
    if (part.wanted) pattern += part.text;
  return filled(pattern, words);
}

constexpr std::string_view header_begin = R"(/* @file@: an observer in C99, made by tokid @version@.
 *
@description@ *
@channels@ *
 * Tables: @table_bytes@ bytes for @stored@; equal steps are stored once. State: @state_bytes@ bytes.
 * Operations of a step at most: @operations@.
)";

constexpr std::string_view header_missing = R"( * If outputs are missing:       @operations_missing@.
)";

constexpr std::string_view header_control = R"( * Operations of the controller: @operations_control@.
)";

constexpr std::string_view header_types = R"( *
 * Rounding errors change a prediction by at most 20 (n + r + m) eps max(1, |C|) = @rounding@ times the largest number
 * among the samples and the sums of absolute terms of a prediction or a new state. This presumes that no outputs are
 * missing that nearly copy each other, and that the state error of the observer decays by at least 5 % in each step:
 * |A + G C| <= 0.95. @decay@
 *
 * The code allocates no memory and calls no function of a library, but compilers may insert calls of memcpy() and
 * memset(). It finds missing samples by comparisons with NaN, so it does not compile with -ffast-math or
 * -ffinite-math-only.
 */
#ifndef @guard@
#define @guard@

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef @real@ @name@_real;

enum { @name@_states = @states_n@, @name@_inputs = @r@, @name@_outputs = @m@ };

/* Status of a call. */
enum {
  @name@_ok = 0,
  @name@_early = 1,      /* before the first step */
  @name@_ended = 2,      /* after the last step */
  @name@_bad_sample = 3, /* an input is missing (NaN) or infinite, or an output is infinite */
  @name@_overflow = 4    /* a result is beyond the range of @real@ */
};

typedef struct {
  @name@_real x[@n@]; /* state before step k, predicted from the samples before step k */
)";

constexpr std::string_view header_held =
    R"(  @name@_real held[@r@]; /* last input minus the nominal one; zero before the controller begins */
)";

constexpr std::string_view header_functions = R"(  uint32_t k;   /* next step; remains at 2^32 - 1 */
  uint32_t row; /* its row in the tables */
} @name@_state;

/* Goes to step 0. */
void @name@_init(@name@_state *state);

/* Advances from step k to k+1 with the samples u (@r@) and y (@m@) of step k. Sets the one-step prediction (@m@) of y,
 * which uses u and the samples before step k, and the innovation (@m@): y minus this prediction. Both may be null
 * pointers.
 * A missing output is NaN, and so is its innovation. @missing_rule@
 * With @name@_ok, the new state is finite, and so are all results but the innovations of missing outputs.
 * With other codes, the prediction and the innovation are not set. With @name@_early, the step is counted;
 * with @name@_ended, @name@_bad_sample and @name@_overflow, the state remains as it was.
 * After @name@_bad_sample and @name@_overflow, call the function again for this step, with
 * samples that are finite, or with outputs marked as missing. If nothing but NaN is left of y and the status remains
 * @name@_overflow, the state itself is too large: set its x to zero, or go to step 0. */
int @name@_step(@name@_state *state, const @name@_real *u, const @name@_real *y,
                @name@_real *prediction, @name@_real *innovation);
)";

constexpr std::string_view header_control_function = R"(
/* The input u (@r@) of step k, from the state before step k. Call @name@_step() afterwards with the input
 * that was applied, for example after limits. The controller has the steps @control_first@ to @control_last@. Before and after
 * it, u is the nominal input, and the status is @name@_early or @name@_ended. With
 * @name@_overflow, u is the nominal input, too. Thus u is finite, except after the last step of the model,
 * where it is not set. */
int @name@_control(const @name@_state *state, @name@_real *u);
)";

constexpr std::string_view header_end = R"(
#ifdef __cplusplus
}
#endif

#endif
)";

constexpr std::string_view source_begin = R"(/* The observer that @file@ describes, made by tokid @version@. */
#include "@file@"

#include <float.h>

#if (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "Missing samples are NaN, which -ffast-math, -ffinite-math-only and /fp:fast ignore: compile this file without them"
#endif

typedef @name@_real real;

enum { STATES = @n@, INPUTS = @r@, OUTPUTS = @m@ };

@tables@static int is_finite(real a)
{
  return a >= -@limit@_MAX && a <= @limit@_MAX;
}

/* sum + a[0] b[0] + a[1] b[1] + ... */
static real add_products(real sum, const real *a, const real *b, int size)
{
  int i;
  for (i = 0; i < size; ++i) sum += a[i] * b[i];
  return sum;
}

)";

constexpr std::string_view source_estimate =
    R"(/* Estimates missing innovations from the available ones. All are weighted sums of independent sources of variance one:
 * e[i] = deviation[i] (F s)[i], with the rows of the lower triangular matrix F one after the other. The smallest sources
 * that explain the available innovations give the missing ones. Each available innovation, one after the other, changes
 * the sources along the part of its row of F that is orthogonal to the rows before. */
static void estimate_missing(const real *deviation, const real *factor, real *e)
{
  real rows[OUTPUTS][OUTPUTS] = {{0}}, square[OUTPUTS] = {0}, sources[OUTPUTS] = {0}, share;
  const real *row = factor;
  int seen[OUTPUTS] = {0}, count = 0, i, j, l;
  for (i = 0; i < OUTPUTS; row += ++i) {
    if (!(e[i] == e[i]) || !(deviation[i] > 0)) continue;
    for (l = 0; l <= i; ++l) rows[count][l] = row[l];
    for (j = 0; j < count; ++j) {
      share = add_products(0, rows[count], rows[j], seen[j] + 1) / square[j];
      for (l = 0; l <= seen[j]; ++l) rows[count][l] -= share * rows[j][l];
    }
    square[count] = add_products(0, rows[count], rows[count], i + 1);
    share = (e[i] / deviation[i] - add_products(0, row, sources, i + 1)) / square[count];
    for (l = 0; l <= i; ++l) sources[l] += share * rows[count][l];
    seen[count++] = i;
  }
  row = factor;
  for (i = 0; i < OUTPUTS; row += ++i)
    if (!(e[i] == e[i])) e[i] = deviation[i] * add_products(0, row, sources, i + 1);
}

)";

constexpr std::string_view source_zero =
    R"(/* Without a covariance, the innovation of a missing output counts as zero. */
static void estimate_missing(real *e)
{
  int j;
  for (j = 0; j < OUTPUTS; ++j)
    if (!(e[j] == e[j])) e[j] = 0;
}

)";

constexpr std::string_view source_advance = R"(static void advance(@name@_state *state)
{
  if (state->k < UINT32_MAX) ++state->k;
  ++state->row;
)";
constexpr std::string_view source_repeat = R"(  if (state->row == @end@) state->row -= @period@;
)";

constexpr std::string_view source_init = R"(}

void @name@_init(@name@_state *state)
{
  int i;
  for (i = 0; i < STATES; ++i) state->x[i] = 0;
)";
constexpr std::string_view init_start = R"(  for (i = 0; i < @n0@; ++i) state->x[i] = start[i];
)";
constexpr std::string_view init_held = R"(  for (i = 0; i < INPUTS; ++i) state->held[i] = 0;
)";

constexpr std::string_view source_step = R"(  state->k = 0;
  state->row = 0;
}

int @name@_step(@name@_state *state, const real *u, const real *y, real *prediction, real *innovation)
{
@row_declaration@  real v[STATES + INPUTS + OUTPUTS]; /* x, u and e */
  real after[STATES];                /* x of the next step */
  real predicted[OUTPUTS];
  real *e;
  const real *matrix;
)";
constexpr std::string_view step_nominal_declaration = R"(  const real *nominal;
)";
constexpr std::string_view step_covariance_declaration = R"(  const real *covariance;
)";
constexpr std::string_view step_checks = R"(  real sum;
@step_declaration@  int i, j, n, next, missing = 0;
)";
constexpr std::string_view step_no_inputs = R"(  (void)u;
)";
constexpr std::string_view step_inputs = R"(  for (i = 0; i < INPUTS; ++i)
    if (!is_finite(u[i])) return @name@_bad_sample;
)";
constexpr std::string_view step_outputs = R"(  for (j = 0; j < OUTPUTS; ++j)
    if (y[j] == y[j] && !is_finite(y[j])) return @name@_bad_sample;
)";
constexpr std::string_view step_ended = R"(  if (row >= @end@) return @name@_ended;
)";
constexpr std::string_view step_early = R"(  if (row < @begin@) {
    advance(state);
    return @name@_early;
  }
)";
constexpr std::string_view step_sizes = R"(@step_of_row@  n = @states@;
  next = @next_states@;
  matrix = @system@;
  for (i = 0; i < n; ++i) v[i] = state->x[i];
)";
constexpr std::string_view step_departure = R"(  nominal = @nominal@;
  for (i = 0; i < INPUTS; ++i) v[n + i] = u[i] - nominal[i];
)";
constexpr std::string_view step_plain_inputs = R"(  for (i = 0; i < INPUTS; ++i) v[n + i] = u[i];
)";
constexpr std::string_view step_hold_from =
    R"(  for (i = 0; i < INPUTS; ++i) state->held[i] = state->k >= @control_begin@ ? v[n + i] : 0;
)";
constexpr std::string_view step_hold = R"(  for (i = 0; i < INPUTS; ++i) state->held[i] = v[n + i];
)";
constexpr std::string_view step_output = R"(  e = v + n + INPUTS;
  for (j = 0; j < OUTPUTS; ++j) {
    sum = add_products(0, matrix, v, n + INPUTS); /* C x + D u */
    matrix += n + INPUTS;
)";
constexpr std::string_view step_innovation_nominal = R"(    e[j] = y[j] - nominal[INPUTS + j] - sum;
    predicted[j] = sum + nominal[INPUTS + j];
)";
constexpr std::string_view step_innovation = R"(    e[j] = y[j] - sum;
    predicted[j] = sum;
)";
constexpr std::string_view step_missing = R"(    if (!is_finite(predicted[j])) return @name@_overflow;
    if (!(y[j] == y[j])) missing = 1;
    else if (!is_finite(e[j])) return @name@_overflow;
  }
)";
constexpr std::string_view step_estimate = R"(  if (missing) {
    covariance = @covariance@;
    estimate_missing(covariance, covariance + OUTPUTS, e);
  }
)";
constexpr std::string_view step_zero = R"(  if (missing) estimate_missing(e);
)";
constexpr std::string_view step_next = R"(  for (i = 0; i < next; ++i) {
    after[i] = add_products(0, matrix, v, n + INPUTS + OUTPUTS); /* A x + B u - G e */
    if (!is_finite(after[i])) return @name@_overflow;
    matrix += n + INPUTS + OUTPUTS;
  }
  /* All results are finite. */
  for (i = 0; i < next; ++i) state->x[i] = after[i];
)";
constexpr std::string_view step_end = R"(  for (j = 0; j < OUTPUTS; ++j) {
    if (prediction) prediction[j] = predicted[j];
    if (innovation) innovation[j] = y[j] == y[j] ? e[j] : y[j];
  }
  advance(state);
  return @name@_ok;
}
)";

constexpr std::string_view control_begin = R"(
int @name@_control(const @name@_state *state, real *u)
{
@control_row_declaration@  const real *law;
)";
constexpr std::string_view control_declarations = R"(  real input[INPUTS], sum;
@control_step_declaration@  int i, n;
)";
constexpr std::string_view control_zero = R"(  for (i = 0; i < INPUTS; ++i) u[i] = 0;
)";
constexpr std::string_view control_nominal = R"(  nominal = @nominal@;
  for (i = 0; i < INPUTS; ++i) u[i] = nominal[i];
)";
constexpr std::string_view control_early = R"(  if (state->k < @control_begin@) return @name@_early;
)";
constexpr std::string_view control_sizes = R"(  if (state->k >= @control_end@) return @name@_ended;
@control_step_of_row@  n = @states@;
@step_of_k@)";
constexpr std::string_view control_law = R"(  law = @law@;
  for (i = 0; i < INPUTS; ++i) {
)";
constexpr std::string_view control_feedforward = R"(    sum = add_products(law[0], law + 1, state->x, n);
    law += 1 + n;
)";
constexpr std::string_view control_feedback = R"(    sum = add_products(0, law, state->x, n);
    law += n;
)";
constexpr std::string_view control_held = R"(    sum = add_products(sum, law, state->held, INPUTS);
    law += INPUTS;
)";
constexpr std::string_view control_add_nominal = R"(    input[i] = u[i] + sum;
)";
constexpr std::string_view control_set = R"(    input[i] = sum;
)";
constexpr std::string_view control_end = R"(    if (!is_finite(input[i])) return @name@_overflow;
  }
  for (i = 0; i < INPUTS; ++i) u[i] = input[i];
  return @name@_ok;
}
)";

}  // namespace

std::string law_comment(bool feedforward, bool held) {
  std::string comment = "of each step of the controller and for each input: ";
  if (feedforward) comment += "the feedforward, ";
  comment += "the row of -K";
  if (held) comment += ", the row of -L";
  return comment;
}

std::string header_text(const Words& given, const Features& has) {
  Words words = given;
  words["missing_rule"] = has.estimates
                              ? "For the state, it is estimated\n * from the innovations of the other outputs."
                              : "For the state, it counts as zero.";
  return joined({{true, header_begin},
                 {has.estimates, header_missing},
                 {has.controller, header_control},
                 {true, header_types},
                 {has.held, header_held},
                 {true, header_functions},
                 {has.controller, header_control_function},
                 {true, header_end}},
                words);
}

namespace {

bool uses(const Words& words, std::initializer_list<const char*> expressions, std::string_view variable) {
  for (const char* name : expressions)
    if (const auto word = words.find(name); word != words.end() && word->second.find(variable) != std::string::npos)
      return true;
  return false;
}

// Declares `row` and `step` where a table needs them, because compilers warn of variables without use.
void declare_rows(const Features& has, Words& words) {
  const std::string row = "  const uint32_t row = state->row;\n", step = "  uint32_t step;\n";
  const std::string of_row = "  step = row" + (has.begins ? " - " + words.at("begin") : "") + ";\n";
  const std::string of_k = "  step = state->k" + (has.control_later ? " - " + words.at("control_begin") : "") + ";\n";
  const bool nominal = uses(words, {"nominal"}, "row"), states = uses(words, {"states"}, "step"),
             law = uses(words, {"law"}, "step");
  const bool steps = states || uses(words, {"system", "covariance"}, "step");
  words["step_declaration"] = steps ? step : "";
  words["step_of_row"] = steps ? of_row : "";
  words["row_declaration"] = !has.period || has.begins || steps || nominal ? row : "";
  words["control_step_declaration"] = states || law ? step : "";
  words["control_step_of_row"] = states ? of_row : "";
  words["control_row_declaration"] = !has.period || states || nominal ? row : "";
  words["step_of_k"] = law ? of_k : "";
}

}  // namespace

std::string source_text(const Words& given, const Features& has) {
  Words words = given;
  declare_rows(has, words);
  const bool inputs = words.at("r") != "0";
  const std::string observer = joined({{true, source_begin},
                                       {has.estimates, source_estimate},
                                       {!has.estimates, source_zero},
                                       {true, source_advance},
                                       {has.period, source_repeat},
                                       {true, source_init},
                                       {has.start, init_start},
                                       {has.held, init_held},
                                       {true, source_step},
                                       {has.nominal, step_nominal_declaration},
                                       {has.estimates, step_covariance_declaration},
                                       {true, step_checks},
                                       {!inputs, step_no_inputs},
                                       {inputs, step_inputs},
                                       {true, step_outputs},
                                       {!has.period, step_ended},
                                       {has.begins, step_early},
                                       {true, step_sizes},
                                       {has.nominal, step_departure},
                                       {!has.nominal, step_plain_inputs},
                                       {true, step_output},
                                       {has.nominal, step_innovation_nominal},
                                       {!has.nominal, step_innovation},
                                       {true, step_missing},
                                       {has.estimates, step_estimate},
                                       {!has.estimates, step_zero},
                                       {true, step_next},
                                       {has.held && has.control_later, step_hold_from},
                                       {has.held && !has.control_later, step_hold},
                                       {true, step_end}},
                                      words);
  if (!has.controller) return observer;
  return observer + joined({{true, control_begin},
                            {has.nominal, step_nominal_declaration},
                            {true, control_declarations},
                            {!has.period, step_ended},
                            {!has.nominal, control_zero},
                            {has.nominal, control_nominal},
                            {has.control_later, control_early},
                            {true, control_sizes},
                            {true, control_law},
                            {has.feedforward, control_feedforward},
                            {!has.feedforward, control_feedback},
                            {has.held, control_held},
                            {has.nominal, control_add_nominal},
                            {!has.nominal, control_set},
                            {true, control_end}},
                           words);
}

}  // namespace tokid::c_code
