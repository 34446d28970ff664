function sys = to_ss(model, k)
% TOKID.TO_SS  One step of a model as a state-space object of the control package (Octave) or toolbox (MATLAB).
%
%   sys = tokid.to_ss(model, k)   the matrices of step k, where 0 is the step of the first sample
%   sys = tokid.to_ss(model)      of a time-invariant model
%
% A discrete-time ss with the model's sample time, channel names and, in MATLAB, units. In Octave, 'pkg load control'
% comes first. A mean motion that was removed is not in it. Errors: tokid:step (no such step, or a step at which the
% number of states changes; without k, a model that varies), tokid:model, tokid:noControl.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
if ischar(model) || isa(model, 'string')
  model = tokid.read(model);
end
tokid.internal.check_model(model, {'A', 'B', 'C', 'D', 'state_dim'});
if isempty(which('ss'))
  error('tokid:noControl', 'the function ss was not found: ''pkg load control'' in Octave, a toolbox in MATLAB');
end
S = size(model.A, 3);
period = 0;
if isfield(model, 'period') && ~isempty(model.period)
  period = model.period;
end
first = 0;
if isfield(model, 'k_begin') && ~isempty(model.k_begin)
  first = model.k_begin;
end
if nargin < 2
  if period ~= 1 && S ~= 1
    error('tokid:step', 'the model varies in time: say the step, tokid.to_ss(model, k)');
  end
  s = S;
  if period == 1 % the last step has all states
    s = find(model.state_dim(1:S) == max(model.state_dim) & model.state_dim(2:S + 1) == max(model.state_dim), 1);
  end
else
  if ~isnumeric(k) || ~isreal(k)
    error('tokid:step', 'a step of class %s found, a whole number needed', class(k));
  end
  k = double(k);
  s = k - first + 1;
  if isscalar(k) && k == fix(k) && s > S && period > 0 && S >= period
    s = S - period + 1 + mod(s - S - 1, period);
  end
  if ~isscalar(k) || k ~= fix(k) || s < 1 || s > S
    error('tokid:step', 'step %s found, the model has the steps %d to %d', mat2str(k), first, first + S - 1);
  end
end
n = model.state_dim(s);
if model.state_dim(s + 1) ~= n
  error('tokid:step', 'step %d leads from %d to %d states, which no ss can hold', first + s - 1, n, ...
        model.state_dim(s + 1));
end
dt = 1;
if isfield(model, 'dt') && ~isempty(model.dt)
  dt = model.dt;
end
sys = ss(model.A(1:n, 1:n, s), model.B(1:n, :, s), model.C(:, 1:n, s), model.D(:, :, s), dt);
if isfield(model, 'input_names') && ~isempty(model.input_names)
  sys = set(sys, 'InputName', cellstr(model.input_names));
end
if isfield(model, 'output_names') && ~isempty(model.output_names)
  sys = set(sys, 'OutputName', cellstr(model.output_names));
end
if ~tokid.internal.is_octave()
  if isfield(model, 'input_units') && ~isempty(model.input_units)
    sys = set(sys, 'InputUnit', cellstr(model.input_units));
  end
  if isfield(model, 'output_units') && ~isempty(model.output_units)
    sys = set(sys, 'OutputUnit', cellstr(model.output_units));
  end
end
end
