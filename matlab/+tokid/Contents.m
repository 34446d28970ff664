% tokid: identification of linear time varying systems from repeated experiments
%
% Data
%   tokid.ensemble      repeated experiments as one struct
%   tokid.example_data  simulated experiments on a system with known answers
%   tokid.plan          how many experiments to make, and inputs for them
%   tokid.read          a model or an ensemble out of a file
%   tokid.write         a model or an ensemble into a file
%
% Models
%   tokid.identify      a time varying model from experiments
%   tokid.refine        maximum likelihood from a model on
%   tokid.update        the model of all experiments, when some come later
%   tokid.to_ss         one step as a state-space object
%
% What a model says
%   tokid.simulate      outputs for given inputs
%   tokid.predict       outputs with the observer in the loop
%   tokid.validate      fits and tests on data
%   tokid.confidence    intervals
%   tokid.modes         natural frequencies and damping ratios over time
%   tokid.report        a page that shows whether to trust the model
%
% What a model is for
%   tokid.lqr           a controller of the departures from the nominal trajectory
%   tokid.learn         the inputs of the next run from a reference and the last run
%   tokid.export        observer and controller as C99 source
%
% The tool
%   tokid.tool          where the command line tool is, which these functions call
%
% Pages such as docs/formats.md are in the folder docs of the source, and on the site of tokid.

% SPDX-License-Identifier: BSD-3-Clause
