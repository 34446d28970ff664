function data = example_data(system, varargin)
% TOKID.EXAMPLE_DATA  Simulated experiments on a system with known answers.
%
%   data = tokid.example_data('oscillator', 'experiments', 200, 'measurement_noise', 0.1)
%
% The system is 'oscillator', the paper's with 4 states, 2 inputs and 2 outputs, or 'rotating-tube' with 2 states, one
% input and one output. The result is a struct with u (N x T x r), y (N x T x m) and dt, as tokid.ensemble makes it.
% Options:
%   'experiments'        N (default 50)
%   'steps'              T (default 100)
%   'seed'               of the random numbers (default 1)
%   'process_noise'      standard deviation of the noise on each state (default 0)
%   'measurement_noise'  standard deviation of the noise on each output (default 0)
%   'free_responses'     experiments without input (default 0)
%   'initial_state'      'zero' (default) or 'unknown': random
%
% Errors: tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'system');
given = {'', 'text', 'system', system; '-o', 'new', 'data.mat', []};
options = 'experiments steps seed process_noise measurement_noise free_responses initial_state';
call = tokid.internal.take('example', given, options, varargin);
[~, data] = tokid.internal.run(call);
end
