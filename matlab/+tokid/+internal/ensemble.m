function [data, lengths] = ensemble(data, needs_outputs, properties)
% [data, lengths] = tokid.internal.ensemble(data, needs_outputs, properties) checks an ensemble, a struct or an iddata
% object, and brings it into the shapes of a file: u N x T x r and y N x T x m of doubles, names as columns of cells.
% The fields of `properties` replace those of the data. Cells of T_i x channels become padded arrays with 'length', and
% `lengths` are their T_i. For arrays, `lengths` is []. Errors: tokid:shape, tokid:option for unknown fields.

% SPDX-License-Identifier: BSD-3-Clause

if isa(data, 'iddata')
  data = tokid.internal.of_iddata(data);
end
if ~isstruct(data) || numel(data) ~= 1 || ~isfield(data, 'u') || (needs_outputs && ~isfield(data, 'y'))
  error('tokid:shape', 'data: a struct with the fields u and y needed, see help tokid.ensemble');
end
names = [{'u', 'y'}, tokid.internal.data_fields()];
foreign = setdiff(fieldnames(data), [names, {'experiments'}]); % which load gives; u has them
if ~isempty(foreign)
  error('tokid:option', 'data: the field %s found, only %s have a meaning', strjoin(foreign(:)', ', '), ...
        strjoin(names, ', '));
end
for name = fieldnames(properties)'
  data.(name{1}) = properties.(name{1});
end
needed = names(1:1 + needs_outputs);
for name = fieldnames(data)'
  if strcmp(name{1}, 'experiments') || (isempty(data.(name{1})) && ~any(strcmp(name{1}, needed)))
    data = rmfield(data, name{1});
  end
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
for name = {'u', 'y', 'free_y'}
  if isfield(data, name{1})
    data.(name{1}) = samples(name{1}, data.(name{1}));
  end
end
[N, T, ~] = size(data.u);
single_steps = numel(lengths) > 1 && T == 1;
if (single_steps || any(lengths < T)) && ~isfield(data, 'length')
  data.length = lengths; % which also tells experiments of one step from a single record
end
if isfield(data, 'y') && ~isequal([size(data.y, 1), size(data.y, 2)], [N, T])
  error('tokid:shape', ['y: %s found beside u of %s, the same experiments and steps needed (N x T x channels; ' ...
                        'a single record is 1 x T x channels, or a cell of T x channels)%s'], ...
        tokid.internal.shape(data.y), tokid.internal.shape(data.u), other_order(data.u, data.y));
elseif T == 1 && N > 1 && ~isfield(data, 'length')
  error('tokid:shape', ['u: %s found, which is %d experiments of one step; a single record is 1 x T x channels, ' ...
                        'or a cell of T x channels'], tokid.internal.shape(data.u), N);
end
data = with_properties(data, N, T);
end

function data = with_properties(data, N, T)
if isfield(data, 'dt')
  if ~isnumeric(data.dt) || ~isscalar(data.dt) || ~isreal(data.dt) || ~(data.dt > 0) || isinf(data.dt)
    error('tokid:option', 'dt: %s found, a positive time in seconds needed', described(data.dt));
  end
  data.dt = double(data.dt);
end
if isfield(data, 'length')
  if ~tokid.internal.is_real(data.length) || numel(data.length) ~= N
    error('tokid:shape', 'length: %s of class %s found, a number for each of %d experiments needed', ...
          tokid.internal.shape(data.length), class(data.length), N);
  end
  data.length = full(double(data.length(:)));
  wrong = find(~(data.length >= 0 & data.length <= T & data.length == fix(data.length)), 1);
  if ~isempty(wrong)
    error('tokid:shape', 'length: %g found for experiment %d, a whole number from 0 to %d needed', ...
          data.length(wrong), wrong, T);
  end
end
if isfield(data, 'experiment_names') && isnumeric(data.experiment_names) && isreal(data.experiment_names)
  data.experiment_names = arrayfun(@(n) sprintf('%.15g', n), double(data.experiment_names(:)), 'UniformOutput', false);
end
for name = {'input_names', 'output_names', 'input_units', 'output_units', 'experiment_names'}
  if isfield(data, name{1})
    value = data.(name{1});
    if ~(ischar(value) || iscellstr(value) || isa(value, 'string'))
      error('tokid:shape', '%s: a value of class %s found, texts needed', name{1}, class(value));
    end
    data.(name{1}) = reshape(cellstr(value), [], 1);
  end
end
if isfield(data, 'experiment_names') && numel(data.experiment_names) ~= N
  error('tokid:shape', 'experiment_names: %d found, a name for each of %d experiments needed', ...
        numel(data.experiment_names), N);
end
if isfield(data, 'initial_state')
  if ~tokid.internal.is_text(data.initial_state) || ~any(strcmp(data.initial_state, {'zero', 'unknown'}))
    error('tokid:option', 'initial_state: %s found, ''zero'' or ''unknown'' needed', described(data.initial_state));
  end
  data.initial_state = char(data.initial_state);
end
end

function text = other_order(u, y)
% The calls that bring the axes into order, if the last axis may be that of the experiments or steps.
text = '';
deep = [ndims(u), ndims(y)] == 3;
if ~any(deep) && size(u, 1) == size(y, 1)
  text = '. If they are one record of T x channels, give {u} and {y}';
elseif any(deep) && isequal([size(u, 1), size(u, ndims(u))], [size(y, 1), size(y, ndims(y))])
  orders = {'[2 1]', '[3 1 2]'};
  others = {'permute(u, [1 3 2])', 'permute(y, [1 3 2])'};
  text = sprintf(['. If the order is T x N or T x channels x N, swap the axes by u = permute(u, %s) and ' ...
                  'y = permute(y, %s). If it is N x channels x T, by %s'], orders{1 + deep(1)}, ...
                 orders{1 + deep(2)}, strjoin(others(deep), ' and '));
end
end

function text = described(value)
if ischar(value) && size(value, 1) == 1
  text = ['''', value, ''''];
elseif isnumeric(value) && isscalar(value) && isreal(value)
  text = sprintf('%g', double(value));
else
  text = sprintf('%s of class %s', tokid.internal.shape(value), class(value));
end
end

function value = samples(name, value)
if ~tokid.internal.is_real(value) || ndims(value) > 3
  error('tokid:shape', '%s: %s of class %s found, real numbers of N x T x channels needed', name, ...
        tokid.internal.shape(value), class(value));
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
