# %% [markdown]
# # A regression of your own
#
# `tokid.stages` has the stages of an identification one by one. Each takes arrays and gives arrays, so a stage of your own
# can replace one of them. Here a ridge regression replaces the regressions of the ARX stage; all that follows remains.
#
#     pip install . matplotlib
#     python examples/python/own_regression.py

# %%
# SPDX-License-Identifier: BSD-3-Clause
import matplotlib.pyplot as plt
import numpy as np
import tokid
from tokid import stages

# %% [markdown]
# ## Few and noisy experiments
#
# The oscillator of the paper varies with every step. With lag order 4, the regression of a step has 18 unknowns for each
# output, and there are only 25 experiments. The errors of such a regression are large.

# %%
noise = {"steps": 40, "process_noise": 0.02, "measurement_noise": 0.05}
data = tokid.example("oscillator", experiments=25, **noise)
fresh = tokid.example("oscillator", experiments=200, seed=3, **noise)
truth = tokid.example_system("oscillator", **noise)
LAGS, STATES = 4, 4
print(data)

# %% [markdown]
# ## The regression
#
# `stages.windows` gives the regressors `W` and the outputs `Y` of a step, with a row for each experiment. The ridge
# regression minimises $\lVert Y - W M^\top \rVert^2 + \rho \lVert M \rVert^2$ at each step. Leave-one-out errors of all
# steps choose $\rho$: a residual, divided by one minus the leverage of its experiment, is the error of a regression
# without this experiment.
#
# A `stages.GtvArx` holds what the next stages need: coefficients with the numbers of inputs and lags, covariances of the
# residuals, and sizes of the outputs.


# %%
def ridge_regression(data, lags, ridge):
    """The ARX model of every step, and its leave-one-out error."""
    m, steps = data.outputs, data.steps
    width = lags * (data.inputs + m) + data.inputs
    coefficients = np.zeros((steps, m, width))
    residual_cov, output_rms, square = np.zeros((steps, m, m)), np.zeros((steps, m)), 0.0
    for k in range(steps):
        window = stages.windows(data, k, lags)  # (N, p (r + m) + r + m)
        W, Y = window[:, :-m], window[:, -m:]
        inverse = np.linalg.inv(W.T @ W + ridge * np.eye(width))
        coefficients[k] = (inverse @ W.T @ Y).T
        residual = Y - W @ coefficients[k].T
        leverage = np.einsum("ij,jk,ik->i", W, inverse, W)
        residual_cov[k] = residual.T @ residual / (len(Y) - leverage.sum())
        output_rms[k] = np.sqrt((Y**2).mean(axis=0))
        square += np.mean((residual / (1 - leverage[:, np.newaxis])) ** 2) / steps
    return stages.GtvArx(coefficients, data.inputs, lags, residual_cov, output_rms), np.sqrt(square)


candidates = 10.0 ** np.arange(-3, 2.5, 0.5)
errors = np.array([ridge_regression(data, LAGS, ridge)[1] for ridge in candidates])
ridge = candidates[np.argmin(errors)]
print(f"rho = {ridge:.3g}, leave-one-out error {errors.min():.3f} (rho = {candidates[0]:g}: {errors[0]:.3f})")

# %% [markdown]
# ## The stages that follow
#
# The same realisation and the same refinement follow three regressions: that of each step alone, the ridge regression, and
# tokid's regression of all steps, which penalises the variation over time instead of the size. The weight of this penalty
# is the one that `tokid.identify` chooses for these data by cross-validation.

# %%
smoothing = tokid.identify(data, lags=LAGS, states=STATES, refine=False).identification.variation.smoothing
print(f"smoothing = {smoothing:g}")
regressions = {
    "each step alone": stages.gtv_arx(data, LAGS),
    "ridge of one's own": ridge_regression(data, LAGS, ridge)[0],
    "coupled steps": stages.smooth_arx(data, LAGS, smoothing=smoothing),
}
models, refined = {}, {}
for name, arx in regressions.items():
    models[name] = stages.subspace(data, arx, states=STATES, smoothing=smoothing)
    refined[name] = stages.refine(models[name], data, smoothing=smoothing, iterations=300, tolerance=1e-4).model

# %% [markdown]
# They are models like any others. Fresh experiments show how good they are: the fit of one-step predictions and of
# simulations, and the relative error of the pulse responses.


# %%
def judge(model):
    found = model.validate(fresh)
    h, exact = model.markov(10), truth.markov(10)
    error = np.sqrt(np.nansum((h - exact) ** 2) / np.nansum(exact**2))
    return found.one_step.fit.mean(), found.simulation.fit.mean(), 100 * error


table = {}
print(f"{'regression':<20}{'':<10}{'one step [%]':>14}{'simulation [%]':>16}{'pulse error [%]':>17}")
for name in regressions:
    for stage, model in (("subspace", models[name]), ("EM", refined[name])):
        table[name, stage] = judge(model)
        print("{:<20}{:<10}{:>14.1f}{:>16.1f}{:>17.1f}".format(name, stage, *table[name, stage]))
table["true system", ""] = judge(truth)
print("{:<20}{:<10}{:>14.1f}{:>16.1f}{:>17.1f}".format("true system", "", *table["true system", ""]))

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
left.loglog(candidates, errors, "ko-")
left.axvline(ridge, color="C1")
left.set(xlabel="ridge ρ", ylabel="leave-one-out error", title="The choice of the ridge")
steps = np.arange(data.steps)
right.plot(steps, truth.markov(2)[:, 1, 0, 0], "k-", lw=2, label="true system")
for number, (name, model) in enumerate(models.items()):
    right.plot(steps, model.markov(2)[:, 1, 0, 0], f"C{number}--", lw=1, label=name)
right.set(xlabel="step k", ylabel="h(k, k-2) from input 1 to output 1", title="A pulse response, before EM")
right.set_ylim(top=1.15)
right.legend(ncols=2)
figure.savefig("own_regression.svg")
