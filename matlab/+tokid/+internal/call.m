function output = call(words, folder)
% output = tokid.internal.call(words, folder) runs the tool. Its warnings become warnings of identifier tokid:COMMAND, its
% complaints errors. `folder` holds the temporary files of the call, which messages name without their paths.
% Errors: tokid:option (wrong option), tokid:input (unusable data or file), tokid:failed (the computation failed),
% tokid:tool (the program is not the tool, or died), tokid:toolNotFound.

% SPDX-License-Identifier: BSD-3-Clause

tool = tokid.tool();
[out, err] = deal(fullfile(folder, 'stdout'), fullfile(folder, 'stderr'));
quoted = cellfun(@argument, [{tool}, words, {out, err}], 'UniformOutput', false);
line = [strjoin(quoted(1:end - 2), ' '), ' >', quoted{end - 1}, ' 2>', quoted{end}];
if ispc()
  % A command that begins with a quotation mark would lose it.
  [status, ~] = system(['cd . & ', line, ' <NUL']);
else
  % The user's shell may be any; the names pass by it in a script.
  script = fullfile(folder, 'call.sh');
  id = fopen(script, 'w');
  fwrite(id, uint8(sprintf('%sexec %s </dev/null\n', environment(), line)), 'uint8');
  fclose(id);
  [status, ~] = system(['/bin/sh ', tokid.internal.quote(script, false)]);
end

output = text_of(out);
lines = tokid.internal.without_paths(regexp(text_of(err), '[^\r\n]+', 'match'), folder);
warned = strncmp(lines, 'tokid: warning: ', 16);
if status ~= 0
  complain(status, tool, lines(~warned), words, folder);
end
for line = lines(warned)
  warning(['tokid:', words{1}], '%s', tokid.internal.in_matlab(strrep(line{1}, 'tokid: warning: ', '')));
end
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
mine = strncmp(words, folder, numel(folder)) | cellfun(@isempty, regexpi(words, '.\.mat$', 'once'));
for file = words(~mine)
  try
    found = whos('-file', file{1});
  catch
    continue % what is absent, or what Octave cannot read
  end
  if numel(found) == 1 && strcmp(found.class, 'struct')
    text = sprintf(['. The variable ''%s'' of %s is a struct, but its fields must be the variables of the file. ' ...
                    'Write it by tokid.write(''%s'', %s), or by save with the option ''-struct'''], ...
                   found.name, file{1}, file{1}, found.name);
    return
  end
end
end

function text = environment()
% MATLAB puts its own libraries before those of the system.
text = '';
if ~tokid.internal.is_octave()
  for name = {'LD_LIBRARY_PATH', 'DYLD_LIBRARY_PATH'}
    value = tokid.internal.without(getenv(name{1}), matlabroot, ':');
    text = sprintf('%s%s=%s\nexport %s\n', text, name{1}, argument(value), name{1});
    if isempty(value)
      text = sprintf('%sunset %s\n', text, name{1});
    end
  end
end
end

function text = argument(text)
% The text as one word of a command line, with a character for each byte of its UTF-8. In Octave texts are so.
if ~tokid.internal.is_octave() && ~ispc()
  text = char(unicode2native(text, 'UTF-8'));
end
text = tokid.internal.quote(text, ispc());
end

function text = text_of(file)
% All of a file in UTF-8; nothing where there is none.
text = '';
id = fopen(file, 'r');
if id >= 0
  text = native2unicode(fread(id, Inf, 'uint8=>uint8')', 'UTF-8');
  fclose(id);
end
end
