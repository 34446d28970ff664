function found = modes(model, varargin)
% TOKID.MODES  Natural frequencies and damping ratios over time, with the time frozen at each step.
%
%   found = tokid.modes(model)
%   found = tokid.modes(model, u, y)           with intervals, by a bootstrap
%   found = tokid.modes(model, data, 'replicates', 100)
%
% The data are those of the identification, all of them; see tokid.ensemble. The struct has the fields of
% 'tokid modes --json': frequency [rad/s], damping, poles_real and poles_imag [1/s], variation, window_change and valid
% have n columns. Row i belongs to step begin + i - 1, at time (begin + i - 1) * dt and with the matrix
% model.A(:, :, begin + i - model.k_begin). Steps at both ends have no row, because the windows need them. Columns
% follow modes; a conjugate pair has two columns. With data,
% there are frequency_lower, frequency_upper, damping_lower and damping_upper. A periodic model has Floquet multipliers,
% multipliers_real, multipliers_imag and multipliers_error, and exponents_real and exponents_imag [1/s]; with data also
% exponents_real_lower and so on. docs/how-to/modes.md says how far to trust frozen modes. Options:
%   'window'      even number of steps whose outputs define the states, or 'auto'
%   'slow'        largest variation of a valid mode (default 0.1)
%   'level', 'replicates', 'seed'   of the intervals
%   'threads'     0 for all of the machine
%
% Warnings have the identifier tokid:modes. Errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
given = {'', 'model', 'model', model; '--confidence', 'data', 'data', []};
options = 'window slow level replicates seed threads';
with_data = ~isempty(varargin) && ~begins_with_option(varargin, strsplit(options));
call = tokid.internal.take('modes', given(1:1 + with_data, :), options, varargin);
of_intervals = intersect(fieldnames(call.said), {'level', 'replicates', 'seed'});
if ~with_data && ~isempty(of_intervals)
  error('tokid:option', 'modes: option ''%s'' found without data. It belongs to the intervals: %s', ...
        of_intervals{1}, 'tokid.modes(model, u, y, ...)');
end
found = tokid.internal.run(call);
end

function yes = begins_with_option(pairs, known)
% Names and values come in pairs, so a text before an even number of arguments is the name of a file. A text that begins
% an even number of arguments is an option, known or misspelled.
yes = tokid.internal.is_text(pairs{1}) && ...
      (mod(numel(pairs), 2) == 0 || any(strcmp(tokid.internal.option_name(pairs{1}), known)));
end
