function [evidence, varargout] = run(call, results)
% [evidence, contents, ...] = tokid.internal.run(call, results) runs the tool for a call of tokid.internal.take. The
% evidence is what the tool prints as JSON. With call.said.print, the tool's report appears in the command window
% instead, and the evidence is []. For each argument of the kind 'new', the contents of this file follow, and then [].
% `results` is the number of results of a function with the option 'print', the second of which is the evidence.
% The tool's warnings become warnings of identifier tokid:COMMAND, its complaints errors.
% Errors: tokid:option (wrong option), tokid:input (unusable data or file), tokid:failed (the computation failed),
% tokid:tool (the program is not the tool, or died), tokid:toolNotFound, tokid:shape, tokid:model, tokid:tooLarge.

% SPDX-License-Identifier: BSD-3-Clause

command = call.command;
printed = isfield(call.said, 'print') && tokid.internal.truth(command, 'print', call.said.print);
if printed && results > 1
  error('tokid:option', ['%s: option ''print'' found beside the result evidence. The tool prints either its report ' ...
                         'or the evidence. Leave one of them out'], command);
end
[folder, clean] = temporary_folder(); %#ok<ASGLU>
words = {regexprep(command, '^(read|write)$', 'convert')};
for i = 1:size(call.given, 1)
  words = [words, words_of(call, folder, call.given{i, :})]; %#ok<AGROW>
end
evidence = [];
if printed
  show(without_paths(output_of(words, folder), folder));
elseif any(strcmp(command, {'read', 'write', 'example', 'predict', 'simulate'}))
  output_of(words, folder);
else
  evidence = decoded(jsondecode(output_of([words, {'--json'}], folder)), folder);
end
new = call.given(strcmp(call.given(:, 2), 'new'), 3);
varargout = cellfun(@(name) contents_of(fullfile(folder, name)), new, 'UniformOutput', false);
varargout{end + 1} = [];
end

function [folder, clean] = temporary_folder()
% The folder is removed when `clean` goes out of scope, also by an error or Ctrl-C.
in_octave = tokid.internal.is_octave();
if in_octave
  before = feval('umask', 77); % Others on the machine have no business with the data.
  restore = onCleanup(@() feval('umask', before));
end
folder = tempname();
[made, message] = mkdir(folder);
if ~made || ~isempty(message) % with a message it was there before, and is not ours
  error('tokid:folder', '%s: no folder can be made for temporary files: %s', folder, message);
end
clean = onCleanup(@() remove(folder));
if ~in_octave && ~ispc()
  [~, ~] = fileattrib(folder, '-r -w -x', 'g o'); % a file system may not permit this
end
mkdir(folder, 'models');
end

function remove(folder)
if tokid.internal.is_octave()
  before = feval('confirm_recursive_rmdir', false);
  restore = onCleanup(@() feval('confirm_recursive_rmdir', before));
end
rmdir(folder, 's');
end

function words = words_of(call, folder, option, kind, name, value)
% The words of the command line for an argument.
words = {};
switch kind
  case 'flag'
    words = repmat({option}, 1, tokid.internal.truth(call.command, name, value));
  case 'switch'
    if ~strcmp(value, 'auto')
      signs = {'--no-', '--'};
      words = {strrep(option, '--', signs{1 + tokid.internal.truth(call.command, name, value)})};
    end
  case 'new'
    words = {option, fullfile(folder, name)};
  case 'text'
    words = {option, char(value)};
  case {'file', 'state'}
    words = {option, tokid.internal.file_name(value)};
  case {'model', 'data', 'reference', 'controller'}
    words = {option, file_of(call, folder, kind, name, value)};
  case {'value', 'list', 'pair', 'weight'}
    words = {option, text_of(call.command, name, kind, value)};
end
if isempty(option) % a file in its place
  words = words(2:end);
end
end

function text = text_of(command, name, kind, value)
if strcmp(kind, 'weight') && isnumeric(value) && ~isvector(value) && ~isempty(value)
  if ~ismatrix(value) || ~isequal(value, diag(diag(value)))
    error('tokid:option', ['%s: option ''%s'': a value of size %s found; one number, one number for each channel ' ...
                           'or a diagonal matrix needed. Python and C++ take full matrices and weights for each ' ...
                           'step'], command, name, mat2str(size(value)));
  end
  value = diag(value);
end
needed = 'numbers or texts';
many = ~isempty(value);
if strcmp(kind, 'value')
  needed = 'a number or a text';
  many = isscalar(value);
end
if tokid.internal.is_text(value)
  text = value;
elseif many && isnumeric(value) && isreal(value)
  text = strrep(sprintf('%.17g,', full(double(value))), 'Inf', 'infinity');
  text = text(1:end - 1);
elseif many && iscellstr(value)
  text = strjoin(value(:)', ',');
else
  error('tokid:option', '%s: option ''%s'': a value of class %s and size %s found, %s needed', command, name, ...
        class(value), mat2str(size(value)), needed);
end
if strcmp(kind, 'pair')
  text = strrep(text, ',', ':');
end
end

function file = file_of(call, folder, kind, name, value)
% The file that was given by its name, or a temporary file with the value.
if ischar(value) || isa(value, 'string') || (strcmp(kind, 'controller') && ~isstruct(value))
  file = tokid.internal.file_name(value);
  return
end
switch kind
  case 'model'
    folder = fullfile(folder, 'models'); % where no other file has the name that the user gave a model
    value = of_model(value);
  case 'data'
    value = of_data(call, value);
  case 'reference'
    name = 'the reference';
    y = reshape(value, [1, size(value)]);
    value = of_data(call, struct('u', zeros(1, size(y, 2)), 'y', y));
end
file = fullfile(folder, [name, '.mat']);
write_mat(file, value);
end

function contents = of_model(model)
% Fields that are empty, or that no model has, are left out.
needed = {'A', 'B', 'C', 'D', 'G', 'state_dim'};
names = {'input_names', 'output_names', 'input_units', 'output_units'};
contents = tokid.internal.check_model(model, needed);
for name = setdiff(fieldnames(contents)', needed)
  value = [];
  if isfield(model, name{1})
    value = model.(name{1});
  end
  if any(strcmp(name{1}, names)) && ~isempty(value)
    contents.(name{1}) = reshape(cellstr(value), [], 1);
  elseif isa(value, 'string')
    contents.(name{1}) = char(value);
  elseif isempty(value) || ~(isnumeric(value) || islogical(value) || ischar(value))
    contents = rmfield(contents, name{1});
  end
end
end

function data = of_data(call, data)
% Data without a sample time get that of the model or the state of the call.
data = tokid.internal.ensemble(data, false, struct());
data.experiments = size(data.u, 1); % which says that N x T is one channel of N experiments
at = find(ismember(call.given(:, 2), {'model', 'state'}), 1);
if isfield(data, 'dt') || isempty(at)
  return
end
[kind, source] = call.given{at, [2, 4]};
if isstruct(source)
  info = source;
elseif strcmp(kind, 'state')
  info = of_state(source);
else
  info = tokid.internal.run(tokid.internal.take('info', {'', 'file', 'model', source}, '', {}));
end
if isfield(info, 'dt') && ~isempty(info.dt)
  data.dt = info.dt;
end
end

function info = of_state(file)
% Nothing else is read, because the state may be large. If it cannot be read, the tool says so.
info = struct();
try
  if tokid.internal.is_octave()
    info = load(file, 'dt');
  else
    info.dt = h5read(file, '/dt');
  end
catch
  return
end
end

function write_mat(file, contents)
% The file is not compressed if that is possible.
format = '-v6';
bytes = max(structfun(@(v) 8 * numel(v), contents));
beyond_ascii = @(v) (ischar(v) || iscell(v)) && nnz(char(v) > 127) > 0;
if bytes >= 2^31 && tokid.internal.is_octave() % which cannot write version 7.3
  error('tokid:tooLarge', ['an array of %.1f GiB found, Octave can write at most 2 GiB; the name of an .h5 can ' ...
                           'be given in place of arrays'], bytes / 2^30);
elseif bytes >= 2^31
  format = '-v7.3';
elseif ~tokid.internal.is_octave() && any(structfun(beyond_ascii, contents))
  format = '-v7'; % -v6 of MATLAB knows no Unicode
end
save(file, '-struct', 'contents', format);
end

function output = output_of(words, folder)
% What the tool prints.
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
  if id < 0
    error('tokid:folder', '%s can''t be written', script);
  end
  fwrite(id, uint8(sprintf('%sexec %s </dev/null\n', environment(), line)), 'uint8');
  fclose(id);
  [status, ~] = system(['/bin/sh ', tokid.internal.quote(script, false)]);
end
output = text_in(out);
lines = without_paths(regexp(text_in(err), '[^\r\n]+', 'match'), folder);
warned = strncmp(lines, 'tokid: warning: ', 16);
if status ~= 0
  complain(status, tool, lines(~warned), words, folder);
end
for line = strrep(lines(warned), 'tokid: warning: ', '')
  warning(['tokid:', words{1}], '%s', tokid.internal.in_matlab(line{1}));
end
end

function text = argument(text)
% The text as one word of a command line, with a character for each byte of its UTF-8. In Octave texts are so.
if ~tokid.internal.is_octave() && ~ispc()
  text = char(unicode2native(text, 'UTF-8'));
end
text = tokid.internal.quote(text, ispc());
end

function text = environment()
% MATLAB puts its own libraries before those of the system.
text = '';
if ~tokid.internal.is_octave()
  for name = {'LD_LIBRARY_PATH', 'DYLD_LIBRARY_PATH'}
    value = tokid.internal.without(getenv(name{1}), matlabroot, ':');
    text = sprintf('%sexport %s=%s\n', text, name{1}, argument(value));
    if isempty(value)
      text = sprintf('%sunset %s\n', text, name{1});
    end
  end
end
end

function text = text_in(file)
% All of a file in UTF-8; nothing where there is none.
text = '';
id = fopen(file, 'r');
if id >= 0
  text = native2unicode(fread(id, Inf, 'uint8=>uint8')', 'UTF-8');
  fclose(id);
end
end

function text = without_paths(text, folder)
% The text with the names of temporary files in place of their paths, which may be broken into lines at blanks.
path = strrep(regexptranslate('escape', [folder, filesep()]), ' ', '\s+');
text = regexprep(text, [path, '(?:models.)?([^/\\]*?)\.(?:mat|h5)'], '$1');
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
  end
end
end

function value = decoded(value, folder)
% Infinite numbers, which JSON has none of, are those; the names of temporary files are [], as what is not known; lists
% of texts are columns of cells, however many they hold.
if ischar(value) && strcmp(value, 'infinity')
  value = Inf;
elseif ischar(value) && strncmp(value, folder, numel(folder))
  value = [];
elseif iscell(value)
  value = cellfun(@(v) decoded(v, folder), value, 'UniformOutput', false);
  if ~isempty(value) && all(cellfun(@(v) isnumeric(v) && isscalar(v), value(:)))
    value = cellfun(@double, value);
  end
end
for i = 1:numel(value) * isstruct(value)
  for name = fieldnames(value)'
    part = decoded(value(i).(name{1}), folder);
    if any(strcmp(name{1}, {'warnings', 'reasons', 'output_names', 'input_names'}))
      part = list_of(part);
    end
    value(i).(name{1}) = part;
  end
end
end

function list = list_of(list)
if isempty(list)
  list = cell(0, 1);
elseif ischar(list) || iscellstr(list)
  list = reshape(cellstr(list), [], 1);
end
end

function show(output)
% The calls of the tool after Next name temporary files. The purpose of such a call goes with it.
purpose = '(;\s+for\s[^:]*|,\s+for\s+example\s[^:]*)?';
fprintf('%s', regexprep(output, ['((^|\n)Next .*?)', purpose, ':\s+tokid .*?(?=\n\S|\s*$)'], '$1'));
end

function contents = contents_of(file)
if strcmp(file(end - 2:end), '.h5')
  contents = tokid.read(file);
else
  contents = load(file, '-mat');
end
if isfield(contents, 'experiments')
  contents = rmfield(contents, 'experiments');
end
end
