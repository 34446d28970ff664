function call = take(command, given, options, pairs)
% call = tokid.internal.take(command, given, options, pairs) gathers what tokid.internal.run needs for a call of the
% tool. `given` has a row {option, kind, name, value} for each argument of the command line, with '' if no option leads
% to it. A temporary file for the value gets the name, which messages show. `options` lists the options of the function
% as 'name' or 'name:kind'. `pairs` are the names and values of the user, which begin with the data if a row has the
% kind 'data' and no value. The options of the user become rows of call.given, and fields of call.said. `lengths`: as
% tokid.internal.ensemble has it. Kinds:
%   value       a number or a text, for options without a kind
%   flag        true or false
%   switch      true, false or 'auto': --name, --no-name, nothing
%   list        a, b, ...: numbers or texts
%   pair        two numbers: a:b
%   weight      numbers, or a diagonal matrix, which the tool gets as its diagonal
%   text        a text as it is
%   file, state the name of a file, or of a state for tokid.update
%   new         a temporary file that the tool writes; its name has an extension
%   model, data, reference, controller   the struct of a model, an ensemble, wanted outputs (T x m), a controller, which
%               go into a temporary file; or the name of a file
%   own         nothing that the tool knows
% Errors: tokid:shape, tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

known = cellfun(@(option) strsplit([option, ':value'], ':'), strsplit(options), 'UniformOutput', false);
names = cellfun(@(option) option{1}, known, 'UniformOutput', false);
lengths = [];
at = find(strcmp(given(:, 2), 'data') & cellfun(@isempty, given(:, 4)));
if isempty(at)
  said = tokid.internal.options(command, names, pairs);
else
  [given{at, 4}, said, lengths] = tokid.internal.take_data(command, names, pairs, true);
end
for name = fieldnames(said)'
  kind = known{strcmp(name{1}, names)}{2};
  given(end + 1, :) = {['--', strrep(name{1}, '_', '-')], kind, name{1}, said.(name{1})}; %#ok<AGROW>
end
call = struct('command', command, 'given', {given}, 'said', said, 'lengths', lengths);
end
