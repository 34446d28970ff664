function [words, own] = options(command, known, pairs, others)
% [words, own] = tokid.internal.options(command, known, pairs, others) makes arguments of the tool out of names and
% values. `known` has a row {name, kind} for each option; `others` are names for the messages only. Kinds:
%   value    a number or a word
%   flag     true or false
%   switch   true, false or 'auto': --name, --no-name, nothing
%   list     a, b, ...: numbers or texts
%   pair     two numbers: a:b
%   file     the name of a file
%   own      nothing that the tool knows: given back as a field of `own`
% Errors: tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

words = {};
own = struct();
for i = 1:2:numel(pairs)
  name = tokid.internal.option_name(pairs, i);
  at = find(strcmp(name, known(:, 1)));
  if isempty(at)
    if nargin < 4
      others = {};
    end
    if i == numel(pairs) && any(strcmp(name, others))
      error('tokid:option', '%s: option ''%s'' has no value', command, name);
    end
    error('tokid:option', '%s: option ''%s'' found, one of %s needed', command, char(pairs{i}), ...
          strjoin(unique([known(:, 1)', others]), ', '));
  end
  if i == numel(pairs)
    error('tokid:option', '%s: option ''%s'' has no value', command, name);
  end
  value = pairs{i + 1};
  if isa(value, 'string') && isscalar(value)
    value = char(value);
  end
  kind = known{at, 2};
  if strcmp(kind, 'own')
    own.(name) = value;
    continue
  end
  option = ['--', strrep(name, '_', '-')];
  switch kind
    case 'flag'
      if truth(command, name, value)
        words{end + 1} = option; %#ok<AGROW>
      end
    case 'switch'
      if ischar(value) && strcmp(value, 'auto')
        continue
      elseif truth(command, name, value)
        words{end + 1} = option; %#ok<AGROW>
      else
        words{end + 1} = ['--no-', option(3:end)]; %#ok<AGROW>
      end
    otherwise
      words = [words, {option, text_of(command, name, kind, value)}]; %#ok<AGROW>
  end
end
end

function yes = truth(command, name, value)
if ~(islogical(value) || isnumeric(value)) || ~isscalar(value) || ~(value == 0 || value == 1)
  error('tokid:option', '%s: option ''%s'': true or false needed', command, name);
end
yes = value == 1;
end

function text = text_of(command, name, kind, value)
switch kind
  case 'list'
    if isa(value, 'string')
      value = cellstr(value);
    end
    if isnumeric(value) && isreal(value) && ~isempty(value)
      text = strjoin(arrayfun(@number, value(:)', 'UniformOutput', false), ',');
      return
    elseif iscellstr(value) && ~isempty(value)
      text = strjoin(value(:)', ',');
      return
    end
  case 'pair'
    if isnumeric(value) && isreal(value) && numel(value) == 2
      text = [number(value(1)), ':', number(value(2))];
      return
    end
  case 'file'
    if ischar(value)
      text = tokid.internal.file_name(value);
      return
    end
  otherwise
    if isnumeric(value) && isreal(value) && isscalar(value)
      text = number(value);
      return
    end
end
if ~ischar(value) || size(value, 1) ~= 1
  error('tokid:option', '%s: option ''%s'': a value of class %s and size %s found, %s needed', command, name, ...
        class(value), mat2str(size(value)), needed(kind));
end
text = value;
end

function text = needed(kind)
switch kind
  case 'list'
    text = 'numbers or texts';
  case 'pair'
    text = 'two numbers';
  case 'file'
    text = 'the name of a file';
  otherwise
    text = 'a number or a text';
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
