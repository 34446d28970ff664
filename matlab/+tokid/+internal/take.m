function call = take(command, given, options, pairs)
% call = tokid.internal.take(command, given, options, pairs) gathers what tokid.internal.run needs for a call of the
% tool. `given` has a row {option, kind, name, value} for each argument of the command line, with '' if no option leads
% to it. A temporary file for the value gets the name, which messages show. `options` lists the options of the function
% as 'name' or 'name:kind'. `pairs` are the names and values of the user, which begin with the data if a row has the
% kind 'data' and no value. tokid.internal.words describes the kinds. The options of the user become call.said.
% Errors: tokid:shape, tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

known = regexp(options, '(\w+):?(\w*)', 'tokens');
known = vertcat(cell(0, 2), known{:});
call = struct('command', command, 'given', {given}, 'known', {known}, 'lengths', []);
at = find(strcmp(given(:, 2), 'data') & cellfun(@isempty, given(:, 4)));
if isempty(at)
  call.said = tokid.internal.options(command, known(:, 1)', pairs);
else
  [call.given{at, 4}, call.said, call.lengths] = tokid.internal.take_data(command, known(:, 1)', pairs, true);
end
end
