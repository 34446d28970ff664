function text = quote(text, windows)
% One argument of a command line, quoted so that no character of it has a meaning: for /bin/sh, or for cmd.exe and the
% programs that it starts. Errors: tokid:quote for what cmd.exe has no quotes for.

% SPDX-License-Identifier: BSD-3-Clause

if any(text == 0) || (windows && any(ismember(text, sprintf('"%%!\r\n'))))
  error('tokid:quote', '''%s'': characters found that no argument of a program can hold here', text);
end
if windows
  behind = numel(text) - numel(regexprep(text, '\\+$', ''));
  text = ['"', text, repmat('\', 1, behind), '"'];
else
  text = ['''', strrep(text, '''', '''\'''''), ''''];
end
end
