# SPDX-License-Identifier: BSD-3-Clause
"""The order of the site: which pages, Python names and C++ headers stand together.

A page, a name or a header that is in no list still gets its place, in the last group of its kind.
"""

# Pages that stand before all sections: page → (title of its card, sentence)
FIRST = {
    "install": ("Install", "Install the wheel or the Debian package, or build tokid from source."),
    "tutorial": ("Tutorial", "From data to a model in ten minutes."),
}

# Sections of the site: folder → (title, sentence, pages of docs/; patterns are allowed, whose pages have the order of
# docs/index.md). A section of docs/index.md with the title becomes the first page of the section.
SECTIONS = {
    "how-to": ("How-to pages", "One task each: noise, gaps, jumps, large data, control, C code.", ["how-to/*"]),
    "explanation": ("Explanations", "Why tokid does what it does, and the mathematics.",
                    ["explanation/*", "math", "implementation"]),
    "reference": ("Reference", "Commands, Python, C++, MATLAB, files, terms.",
                  ["reference/commands", "reference/python/index", "reference/cpp/index", "reference/matlab-functions",
                   "python", "python-interop", "matlab", "formats", "glossary", "troubleshooting"]),
    "evidence": ("Evidence", "Measurements: accuracy, time, plants whose truth is known, other tools.",
                 ["comparison", "evidence", "plants", "performance", "agreement", "portability"]),
    "project": ("Project", "Changes, contributions, security.", ["project/*"]),
}

# Files of the repository outside docs/ that are pages → their place on the site
PAGES = {
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "SECURITY.md": "project/security.md",
}

# The gallery: examples of examples/python in their order, measured data first
EXAMPLES = ["pendubot", "robot_arm", "cd_player", "mujoco_swing_up", "mujoco_crane", "plan", "learning", "modes",
            "paper_example", "own_regression"]

# Python: page → (title, sentence, names)
PYTHON = {
    "identify": ("Identify", "From data to a model.",
                 ["tokid.identify", "tokid.identify_file", "tokid.cross_validate", "tokid.update", "tokid.UpdateState"]),
    "data": ("Data", "Ensembles of experiments, files, examples, plans of experiments.",
             ["tokid.Ensemble", "tokid.load", "tokid.plan", "tokid.Plan", "tokid.example", "tokid.example_system",
              "tokid.paper", "tokid.FileLock"]),
    "model": ("Model", "The identified model: matrices, simulation, prediction, files.",
              ["tokid.Model", "tokid.Step", "tokid.MatrixSequence"]),
    "validate": ("Validate", "The evidence of an identification and of a validation.",
                 ["tokid.Identification", "tokid.Validation", "tokid.Verdict", "tokid.Fit", "tokid.CrossValidation",
                  "tokid.Finding", "tokid.Confidence", "tokid.Interval", "tokid.FunctionBounds", "tokid.Refinement"]),
    "control": ("Control", "Observers and controllers.",
                ["tokid.Controller", "tokid.Observer", "tokid.Observation", "tokid.ClosedLoop", "tokid.ExpectedCost"]),
    "learning": ("Learning", "Iterative learning control.", ["tokid.LearnedRun", "tokid.LiftedMap"]),
    "modes": ("Modes", "Natural frequencies, damping ratios and shapes over time.", ["tokid.Modes"]),
    "export": ("Export", "Models and controllers as C99 source.", ["tokid.ExportedCode"]),
    "stages": ("Stages", "The stages of an identification, to replace one of them.", ["tokid.stages"]),
    "plot": ("Plots", "Pictures with Matplotlib.", ["tokid.plot"]),
    "interop": ("Other packages", "pandas, xarray, SciPy, python-control.", ["tokid.interop"]),
    "other": ("Errors, progress, results", "Everything else that calls raise, report or return.",
              ["tokid.IoError", "tokid.TokidWarning", "tokid.ProgressShare"]),
}

# C++: page → (title, headers of include/tokid)
CPP = {
    "identify": ("Identify", ["identify", "options", "choices", "plan", "lag_orders", "cross_validate", "stream", "team",
                              "update", "progress", "parallel"]),
    "data": ("Data", ["ensemble", "runs", "ensemble_file", "io", "windows", "design", "example", "file_lock", "types"]),
    "model": ("Model", ["model", "step", "model_file", "provenance"]),
    "validate": ("Validate and diagnose", ["validate", "innovations", "conclusion", "finding", "remarks", "corrections",
                                           "outlier", "copies", "uncertainty", "report"]),
    "control": ("Control and learning", ["control", "controller_file", "learning", "observer", "online_observer"]),
    "modes": ("Modes", ["modes"]),
    "export": ("Export", ["deploy"]),
    "stages": ("Stages", ["gtv_arx", "smooth_arx", "random_walk", "markov", "tvera", "subspace", "em", "refine_model",
                          "stage_values"]),
    "other": ("Foundations", ["tokid", "linalg", "paper", "printable"]),
}
