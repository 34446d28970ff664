function data = ensemble(data, needs_outputs)
% data = tokid.internal.ensemble(data, needs_outputs) checks an ensemble and brings it into the shapes of a file:
% u N x T x r and y N x T x m of doubles, names as columns of cells. Cells of T_i x channels become padded arrays with
% 'length'. Errors: tokid:shape.

% SPDX-License-Identifier: BSD-3-Clause

if ~isstruct(data) || numel(data) ~= 1 || ~isfield(data, 'u') || (needs_outputs && ~isfield(data, 'y'))
  error('tokid:shape', 'data: a struct with the fields u and y needed, see help tokid.ensemble');
end
names = [{'u', 'y'}, tokid.internal.data_fields()];
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
if any(lengths < size(data.u, 2)) && ~isfield(data, 'length')
  data.length = lengths;
end

data.u = samples('u', data.u);
if isfield(data, 'y')
  data.y = samples('y', data.y);
  if size(data.y, 1) ~= size(data.u, 1) || size(data.y, 2) ~= size(data.u, 2)
    error('tokid:shape', ['y: %s found beside u of %s, the same experiments and steps needed (N x T x channels; ' ...
                          'a single record is 1 x T x channels, or a cell of T x channels)'], ...
          shape(data.y), shape(data.u));
  end
end
if size(data.u, 2) == 1 && size(data.u, 1) > 1
  error('tokid:shape', ['u: %s found, which is %d experiments of one step; a single record is 1 x T x channels, ' ...
                        'or a cell of T x channels'], shape(data.u), size(data.u, 1));
end
if isfield(data, 'free_y')
  data.free_y = samples('free_y', data.free_y);
end
if isfield(data, 'length')
  data.length = double(data.length(:));
end
names = {'input_names', 'output_names', 'input_units', 'output_units'};
for i = 1:numel(names)
  if isfield(data, names{i})
    data.(names{i}) = reshape(cellstr(data.(names{i})), [], 1);
  end
end
if isfield(data, 'initial_state')
  data.initial_state = char(data.initial_state);
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
