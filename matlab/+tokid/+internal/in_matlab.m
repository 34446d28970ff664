function text = in_matlab(text)
% text = tokid.internal.in_matlab(text) gives a message of the tool in the terms of MATLAB: names of options as they are
% given here, help for functions, and the calls that bring axes into order.

% SPDX-License-Identifier: BSD-3-Clause

text = regexprep(text, 'see ''tokid ([a-z]+) --help''', 'see ''help tokid.$1''');
text = regexprep(text, '--no-(feedthrough|refine)(?![\w-])', '''$1'', false');
% Not within the name of a file, such as './--x' or '--x.mat'.
[rest, names] = regexp(text, '(?<![\w./''"-])--[a-z][a-z0-9-]*(?![\w.-]*\.\w)', 'split', 'match');
names = cellfun(@(name) ['''', strrep(name(3:end), '-', '_'), ''''], names, 'UniformOutput', false);
pieces = [rest; [names, {''}]];
text = [pieces{:}];
text = regexprep(text, '^''(\w+)'':', 'option ''$1'':');

order = regexp(text, 'not \((N, channels, T|T, N, channels)\)', 'tokens', 'once');
if isempty(order)
  return
elseif strcmp(order{1}, 'T, N, channels')
  text = [text, '. If so, swap them by u = permute(u, [2 1 3]) and y = permute(y, [2 1 3])'];
else
  text = [text, '. If so, swap them by permute(u, [1 3 2]) and permute(y, [1 3 2]), or by permute(u, [3 1 2]) and ' ...
                'permute(y, [3 1 2]) if the axes are (T, channels, N)'];
end
end
