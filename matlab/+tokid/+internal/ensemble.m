function data = ensemble(data, needs_outputs)
% data = tokid.internal.ensemble(data, needs_outputs) checks an ensemble and brings it into the shapes of a file:
% u N x T x r and y N x T x m of doubles, names as columns of cells. Cells of T_i x channels become padded arrays with
% 'length'. Errors: tokid:shape, tokid:option for what can't be said of data.

% SPDX-License-Identifier: BSD-3-Clause

if ~isstruct(data) || numel(data) ~= 1 || ~isfield(data, 'u') || (needs_outputs && ~isfield(data, 'y'))
  error('tokid:shape', 'data: a struct with the fields u and y needed, see help tokid.ensemble');
end
names = [{'u', 'y'}, tokid.internal.data_fields()];
foreign = setdiff(fieldnames(data), [names, {'experiments'}]); % which load gives; u has them
if ~isempty(foreign)
  error('tokid:option', 'data: the field %s found, only %s have a meaning', strjoin(foreign(:)', ', '), ...
        strjoin(names, ', '));
end
kept = struct();
for i = 1:numel(names)
  if isfield(data, names{i}) && (i <= 2 || ~isempty(data.(names{i})))
    kept.(names{i}) = data.(names{i});
  end
end
data = kept;
if isfield(data, 'y') && isempty(data.y) && ~needs_outputs
  data = rmfield(data, 'y');
end

lengths = [];
if iscell(data.u)
  [data.u, lengths] = padded('u', data.u);
end
if isfield(data, 'y') && iscell(data.y)
  [data.y, of_outputs] = padded('y', data.y);
  if ~isequal(of_outputs, lengths)
    error('tokid:shape', 'y: cells of %s steps found, the cells of u have %s', mat2str(of_outputs'), mat2str(lengths'));
  end
end
single_steps = numel(lengths) > 1 && size(data.u, 2) == 1;
if (single_steps || any(lengths < size(data.u, 2))) && ~isfield(data, 'length')
  data.length = lengths; % which also tells experiments of one step from a single record
end

data.u = samples('u', data.u);
if isfield(data, 'y')
  data.y = samples('y', data.y);
  if size(data.y, 1) ~= size(data.u, 1) || size(data.y, 2) ~= size(data.u, 2)
    error('tokid:shape', ['y: %s found beside u of %s, the same experiments and steps needed (N x T x channels; ' ...
                          'a single record is 1 x T x channels, or a cell of T x channels)%s'], ...
          shape(data.y), shape(data.u), other_order(data.u, data.y));
  end
end
if size(data.u, 2) == 1 && size(data.u, 1) > 1 && ~isfield(data, 'length')
  error('tokid:shape', ['u: %s found, which is %d experiments of one step; a single record is 1 x T x channels, ' ...
                        'or a cell of T x channels'], shape(data.u), size(data.u, 1));
end
if isfield(data, 'free_y')
  data.free_y = samples('free_y', data.free_y);
end
if isfield(data, 'dt')
  data.dt = sample_time(data.dt);
end
if isfield(data, 'length')
  data.length = valid_steps(data.length, size(data.u, 1), size(data.u, 2));
end
if isfield(data, 'experiment_names')
  data.experiment_names = labels(data.experiment_names, size(data.u, 1));
end
names = {'input_names', 'output_names', 'input_units', 'output_units', 'experiment_names'};
for i = 1:numel(names)
  if isfield(data, names{i})
    value = data.(names{i});
    if ~(ischar(value) || iscellstr(value) || isa(value, 'string'))
      error('tokid:shape', '%s: a value of class %s found, texts needed', names{i}, class(value));
    end
    data.(names{i}) = reshape(cellstr(value), [], 1);
  end
end
if isfield(data, 'initial_state')
  value = data.initial_state;
  if isa(value, 'string') && isscalar(value)
    value = char(value);
  end
  if ~ischar(value) || ~any(strcmp(value, {'zero', 'unknown'}))
    error('tokid:option', 'initial_state: %s found, ''zero'' or ''unknown'' needed', described(value));
  end
  data.initial_state = value;
end
end

function text = other_order(u, y)
% The calls that bring the axes into order, if the last axis may be that of the experiments or steps.
text = '';
if ndims(u) == 3 && ndims(y) == 3 && isequal([size(u, 1), size(u, 3)], [size(y, 1), size(y, 3)])
  text = ['. If the order is T x channels x N, swap the axes by u = permute(u, [3 1 2]) and ' ...
          'y = permute(y, [3 1 2]). If it is N x channels x T, by permute(u, [1 3 2]) and permute(y, [1 3 2])'];
elseif ndims(u) == 2 && ndims(y) == 3 && isequal(size(u), [size(y, 1), size(y, 3)]) %#ok<ISMAT>
  text = ['. If the orders are T x N and T x channels x N, swap the axes by u = permute(u, [2 1]) and ' ...
          'y = permute(y, [3 1 2]). If y is N x channels x T, by y = permute(y, [1 3 2])'];
elseif ndims(u) == 3 && ndims(y) == 2 && isequal(size(y), [size(u, 1), size(u, 3)]) %#ok<ISMAT>
  text = ['. If the orders are T x channels x N and T x N, swap the axes by u = permute(u, [3 1 2]) and ' ...
          'y = permute(y, [2 1]). If u is N x channels x T, by u = permute(u, [1 3 2])'];
elseif ndims(u) == 2 && ndims(y) == 2 && size(u, 1) == size(y, 1) %#ok<ISMAT>
  text = '. If they are one record of T x channels, give {u} and {y}';
end
end

function dt = sample_time(dt)
if ~isnumeric(dt) || ~isscalar(dt) || ~isreal(dt) || ~(dt > 0) || isinf(dt)
  error('tokid:option', 'dt: %s found, a positive time in seconds needed', described(dt));
end
dt = double(dt);
end

function lengths = valid_steps(lengths, N, T)
if ~(isnumeric(lengths) || islogical(lengths)) || ~isreal(lengths) || numel(lengths) ~= N
  error('tokid:shape', 'length: %s of class %s found, a number for each of %d experiments needed', shape(lengths), ...
        class(lengths), N);
end
lengths = full(double(lengths(:)));
wrong = find(~(lengths >= 0 & lengths <= T & lengths == fix(lengths)), 1);
if ~isempty(wrong)
  error('tokid:shape', 'length: %g found for experiment %d, a whole number from 0 to %d needed', lengths(wrong), ...
        wrong, T);
end
end

function names = labels(names, N)
% Numbers may be names too.
if isnumeric(names) && isreal(names)
  names = arrayfun(@(n) sprintf('%.15g', n), double(full(names(:))), 'UniformOutput', false);
end
if iscellstr(names) || isa(names, 'string')
  found = numel(names);
else
  found = size(names, 1); % of char
end
if found ~= N
  error('tokid:shape', 'experiment_names: %d found, a name for each of %d experiments needed', found, N);
end
end

function text = described(value)
if ischar(value) && size(value, 1) == 1
  text = ['''', value, ''''];
elseif isnumeric(value) && isscalar(value) && isreal(value)
  text = sprintf('%g', double(value));
else
  text = sprintf('%s of class %s', shape(value), class(value));
end
end

function value = samples(name, value)
if ~(isnumeric(value) || islogical(value)) || ~isreal(value) || ndims(value) > 3
  error('tokid:shape', '%s: %s of class %s found, real numbers of N x T x channels needed', name, shape(value), ...
        class(value));
end
value = full(double(value));
end

function [array, lengths] = padded(name, cells)
% N x T x channels, with NaN behind the end of each experiment
lengths = cellfun(@(c) size(c, 1), cells(:));
channels = unique(cellfun(@(c) size(c, 2), cells(:)));
if numel(channels) ~= 1 || any(cellfun(@ndims, cells(:)) > 2)
  error('tokid:shape', '%s: cells of T x channels needed, with the same channels in each', name);
end
array = nan(numel(cells), max(lengths), channels);
for i = 1:numel(cells)
  array(i, 1:lengths(i), :) = reshape(samples(name, cells{i}), 1, lengths(i), channels);
end
end

function text = shape(value)
text = strjoin(arrayfun(@(n) sprintf('%d', n), size(value), 'UniformOutput', false), ' x ');
end
