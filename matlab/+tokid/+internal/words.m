function words = words(call, folder, option, kind, name, value)
% words = tokid.internal.words(call, folder, option, kind, name, value) makes words of the command line out of an
% argument of the `call`. Kinds:
%   (none)      a number or a text
%   flag        true or false
%   switch      true, false or 'auto': --name, --no-name, nothing
%   list        a, b, ...: numbers or texts
%   pair        two numbers: a:b
%   weight      numbers, or a diagonal matrix, which the tool gets as its diagonal
%   text, file  a text as it is, the name of a file
%   new         a temporary file that the tool writes
%   model, data, reference, controller   the struct of a model, an ensemble, wanted outputs (T x m), a controller, which
%               go into a temporary file; or the name of a file
%   own         nothing that the tool knows
% Errors: tokid:option, tokid:input, tokid:shape, tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

switch kind
  case 'own'
    words = {};
  case 'flag'
    words = repmat({option}, 1, tokid.internal.truth(call.command, name, value));
  case 'switch'
    if tokid.internal.is_text(value) && strcmp(value, 'auto')
      words = {};
    elseif tokid.internal.truth(call.command, name, value)
      words = {option};
    else
      words = {strrep(option, '--', '--no-')};
    end
  case 'new'
    words = [option, {fullfile(folder, [name, extension(call)])}];
  case 'text'
    words = [option, {char(value)}];
  case 'file'
    words = [option, {tokid.internal.file_name(value)}];
  case {'model', 'data', 'reference', 'controller'}
    words = [option, {tokid.internal.written(call, folder, kind, name, value)}];
  otherwise
    words = {option, text_of(call.command, name, kind, value)};
end
words = words(~cellfun(@isempty, words));
end

function ending = extension(call)
% A model of an .h5 may be too large for memory before it is converted.
ending = '.mat';
if strcmp(call.command, 'identify') && ischar(call.given{1, 4})
  [~, ~, of_data] = fileparts(call.given{1, 4});
  if any(strcmpi(of_data, {'.h5', '.hdf5'}))
    ending = '.h5';
  end
end
end

function text = text_of(command, name, kind, value)
if strcmp(kind, 'weight') && isnumeric(value) && ~isvector(value) && ~isempty(value)
  if ~ismatrix(value) || ~isequal(value, diag(diag(value)))
    error('tokid:option', ['%s: option ''%s'': a value of size %s found; one number, one number for each channel ' ...
                           'or a diagonal matrix needed. Python and C++ take full matrices and weights for each ' ...
                           'step'], command, name, mat2str(size(value)));
  end
  value = full(diag(value));
end
many = ~isempty(kind) && ~isempty(value);
if tokid.internal.is_text(value)
  text = char(value);
elseif isnumeric(value) && isreal(value) && (isscalar(value) || many)
  separators = {',', ':'};
  text = strjoin(arrayfun(@number, value(:)', 'UniformOutput', false), separators{1 + strcmp(kind, 'pair')});
elseif many && (iscellstr(value) || isa(value, 'string')) %#ok<ISCLSTR>
  text = strjoin(cellstr(value(:)'), ',');
else
  needed = {'a number or a text', 'numbers or texts'};
  error('tokid:option', '%s: option ''%s'': a value of class %s and size %s found, %s needed', command, name, ...
        class(value), mat2str(size(value)), needed{1 + ~isempty(kind)});
end
end

function text = number(value)
value = double(value);
if isinf(value) && value > 0
  text = 'infinity';
elseif value == fix(value) && abs(value) < 2^53
  text = sprintf('%d', value);
else
  text = sprintf('%.17g', value);
end
end
