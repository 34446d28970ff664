function [output, warnings] = call(words, folder, files)
% [output, warnings] = tokid.internal.call(words, folder, files) runs the tool. Its warnings become warnings of
% identifier tokid:COMMAND, its complaints errors. `folder` holds the temporary files of the call; `files` has a row
% {path, name} for each one that messages should name otherwise.
% Errors: tokid:option (wrong option), tokid:input (unusable data or file), tokid:failed (the computation failed),
% tokid:tool (the program is not the tool, or died), tokid:toolNotFound.

% SPDX-License-Identifier: BSD-3-Clause

tool = tokid.tool();
out = fullfile(folder, 'stdout');
err = fullfile(folder, 'stderr');
windows = ispc();
quoted = cellfun(@(a) tokid.internal.quote(tokid.internal.bytes(a), windows), [{tool}, words, {out, err}], ...
                 'UniformOutput', false);
line = [strjoin(quoted(1:end - 2), ' '), ' >', quoted{end - 1}, ' 2>', quoted{end}];
if windows
  % A command that begins with a quotation mark would lose it.
  status = run(['cd . & ', line, ' <NUL']);
else
  % The user's shell may be any; the names pass by it in a script.
  script = fullfile(folder, 'call.sh');
  write(script, sprintf('%sexec %s </dev/null\n', environment(), line));
  status = run(['/bin/sh ', tokid.internal.quote(script, false)]);
end

output = tokid.internal.read_text(out);
lines = regexp(tokid.internal.read_text(err), '[^\r\n]+', 'match');
for i = 1:size(files, 1)
  lines = strrep(lines, files{i, 1}, files{i, 2});
end
warned = strncmp(lines, 'tokid: warning: ', 16);
warnings = cellfun(@tokid.internal.in_matlab, strrep(lines(warned), 'tokid: warning: ', ''), 'UniformOutput', false);
if status ~= 0
  complain(status, tool, lines(~warned), words, folder);
end
for i = 1:numel(warnings)
  warning(['tokid:', words{1}], '%s', warnings{i});
end
end

function status = run(command)
[status, ~] = system(command);
end

function complain(status, tool, lines, words, folder)
said = find(strncmp(lines, 'tokid: ', 7), 1, 'last');
if isempty(said) || ~any(status == [1, 2])
  error('tokid:tool', '%s', strjoin([{sprintf('%s ended with status %d', tool, status)}, lines], '; '));
end
said = lines{said}(8:end);
text = tokid.internal.in_matlab(said);
if status == 1
  error('tokid:failed', '%s', text);
elseif ~isempty(regexp(said, '^--|; see ''tokid [a-z]+ --help''$', 'once'))
  error('tokid:option', '%s', text);
end
error('tokid:input', '%s%s', text, advice(words, folder));
end

function text = advice(words, folder)
% A .mat that `save(file, 'model')` has written holds the whole struct as one variable.
text = '';
for i = 1:numel(words)
  word = words{i};
  if numel(word) > 4 && strcmpi(word(end - 3:end), '.mat') && ~strncmp(word, folder, numel(folder)) && ...
     exist(word, 'file') == 2
    try
      found = whos('-file', word);
    catch
      continue % what Octave can't read
    end
    if numel(found) == 1 && strcmp(found.class, 'struct')
      text = sprintf(['. The variable ''%s'' of %s is a struct, but its fields must be the variables of the file. ' ...
                      'Write it by tokid.write(''%s'', %s), or by save with the option ''-struct'''], ...
                     found.name, word, word, found.name);
      return
    end
  end
end
end

function text = environment()
% MATLAB puts its own libraries before those of the system.
text = '';
if ~tokid.internal.is_octave()
  names = {'LD_LIBRARY_PATH', 'DYLD_LIBRARY_PATH'};
  for i = 1:numel(names)
    value = tokid.internal.without(getenv(names{i}), matlabroot, ':');
    if isempty(value)
      text = sprintf('%sunset %s\n', text, names{i});
    else
      text = sprintf('%s%s=%s\nexport %s\n', text, names{i}, ...
                     tokid.internal.quote(tokid.internal.bytes(value), false), names{i});
    end
  end
end
end

function write(file, text)
id = fopen(file, 'w');
if id < 0
  error('tokid:folder', '%s can''t be written', file);
end
fwrite(id, uint8(text), 'uint8');
fclose(id);
end
