function text = in_matlab(text)
% text = tokid.internal.in_matlab(text) gives a message of the tool in the terms of MATLAB: names of options that the
% functions have, help for functions, and the calls that bring axes into order.

% SPDX-License-Identifier: BSD-3-Clause

text = regexprep(text, 'see ''tokid ([a-z]+) --help''', 'see ''help tokid.$1''');
text = strrep(text, '--inputs ''A,B'' --outputs ''C,D''', '''inputs'', {''A'', ''B''}, ''outputs'', {''C'', ''D''}');
text = regexprep(text, '--no-(feedthrough|refine)(?![\w-])', '''$1'', false');
% Not within the name of a file, such as './--x' or '--x.mat'.
[rest, found] = regexp(text, '(?<![\w./''"-])--[a-z][a-z0-9-]*(?![\w.-]*\.\w)', 'split', 'match');
others = {'--verbose', '--json', '--quiet', '--output', '--version', '--help', '--confidence', '--simulate', ...
          '--experiment', '--picture'};  % only the tool has these options
here = ~ismember(found, others);
words = found;
words(here) = cellfun(@(name) ['''', strrep(name(3:end), '-', '_'), ''''], found(here), 'UniformOutput', false);
pieces = [rest; [words, {''}]];
text = regexprep([pieces{:}], '^''(\w+)'':', 'option ''$1'':');

% The calls of permute that bring the axes into order
order = '(not \(experiments, channels, steps\))';
text = regexprep(text, order, ['$1. Reorder the axes by permute(u, [1 3 2]) and permute(y, [1 3 2]), or by ' ...
                               'permute(u, [3 1 2]) and permute(y, [3 1 2]) if the axes are (T, channels, N)'], 'once');
order = '(not \(steps, experiments, channels\))';
text = regexprep(text, order, ['$1. Reorder the axes by u = permute(u, [2 1 3]) and ' ...
                               'y = permute(y, [2 1 3])'], 'once');
end
