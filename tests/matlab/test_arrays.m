function test_arrays(name)
% What becomes of the arrays that a user gives.

% SPDX-License-Identifier: BSD-3-Clause

feval(name);
end

function case_doubles_of_natural_shapes()
data = tokid.ensemble(single(ones(3, 4)), true(3, 4, 2), 'dt', 0.1, 'length', [4, 2, 3], 'input_names', {'a'}, ...
                      'output_names', {'b', 'c'}, 'initial_state', 'zero');
assert(isa(data.u, 'double') && isequal(size(data.u), [3, 4]));
assert(isa(data.y, 'double') && isequal(size(data.y), [3, 4, 2]));
assert(isequal(data.length, [4; 2; 3]));
assert(isequal(data.output_names, {'b'; 'c'}));
assert(data.dt == 0.1 && strcmp(data.initial_state, 'zero'));
end

function case_cells_are_padded()
u = {[1 2; 3 4; 5 6], [7 8]};
y = {[1; 2; 3], 4};
data = tokid.ensemble(u, y);
assert(isequal(size(data.u), [2, 3, 2]));
assert(isequal(reshape(data.u(1, :, :), 3, 2), u{1}));
assert(isequal(data.length, [3; 1]));
assert(isequaln(data.y, [1 2 3; 4 NaN NaN]));
end

function case_a_single_record_is_a_cell()
data = tokid.ensemble({randn(9, 2)}, {randn(9, 1)});
assert(isequal(size(data.u), [1, 9, 2]) && isequal(size(data.y), [1, 9]));
assert(~isfield(data, 'length'));
end

function case_columns_are_no_single_record()
throws('tokid:shape', '9 experiments of one step; a single record is 1 x T x channels', ...
       @() tokid.ensemble(randn(9, 1), randn(9, 1)));
data = tokid.ensemble({1, 2}, {3, 4});
assert(isequal(data.u, [1; 2]) && isequal(data.y, [3; 4]) && isequal(data.length, [1; 1]));
tokid.write('a.npz', data);
data = by_tool('convert', 'a.npz', 'a.mat');
assert(data.experiments == 2 && isequal(data.u, [1; 2]) && isequal(data.y, [3; 4]));
end

function case_disagreeing_shapes_are_named()
throws('tokid:shape', 'y: 3 x 5 x 2 found beside u of 3 x 4', @() tokid.ensemble(ones(3, 4), ones(3, 5, 2)));
throws('tokid:shape', 'y: cells of [2 3] steps found, the cells of u have [2 4]', ...
       @() tokid.ensemble({ones(2, 1), ones(4, 1)}, {ones(2, 1), ones(3, 1)}));
throws('tokid:shape', 'u: cells of T x channels needed', @() tokid.ensemble({ones(2, 1), ones(4, 2)}));
end

function case_other_things_than_numbers_are_refused()
throws('tokid:shape', 'u: 3 x 4 of class double found, real numbers', @() tokid.ensemble(1i * ones(3, 4)));
throws('tokid:shape', 'y: 3 x 4 of class char found', @() tokid.ensemble(ones(3, 4), repmat('a', 3, 4)));
throws('tokid:shape', 'fields u and y', @() tokid.identify(struct('v', 1)));
throws('tokid:shape', 'y: none found after u of class double', @() tokid.identify(ones(3, 4), 'dt', 1));
throws('tokid:shape', 'data: none found', @() tokid.identify());
end

function case_names_of_what_is_said_of_data()
throws('tokid:option', 'option ''unit'' found, one of dt, experiment_names, free_y, initial_state,', ...
       @() tokid.ensemble(ones(3, 4), ones(3, 4), 'unit', 1));
throws('tokid:option', 'a value of class double found', @() tokid.ensemble(ones(3, 4), ones(3, 4), 'dt', 1, 5));
end

function case_an_ensemble_of_inputs_alone()
data = tokid.ensemble(ones(3, 4), [], 'dt', 2);
assert(~isfield(data, 'y') && data.dt == 2);
end

function case_what_is_said_of_data_is_checked()
% Without the tool, which does not see it where simulate works alone.
said = {{'dt', 'a'}, {'dt', [1 2]}, {'dt', 0}, {'dt', -1}, {'dt', NaN}, {'dt', Inf}, {'dt', 1i}, {'dt', {1}}, ...
        {'initial_state', 'foo'}, {'initial_state', 'auto'}, {'initial_state', 0}, {'initial_state', {'zero'}}};
found = {'''a''', '1 x 2 of class double', '0', '-1', 'NaN', 'Inf', '1 x 1 of class double', '1 x 1 of class cell', ...
         '''foo''', '''auto''', '0', '1 x 1 of class cell'};
for i = 1:numel(said)
  throws('tokid:option', [said{i}{1}, ': ', found{i}, ' found'], @() tokid.ensemble(ones(2, 5), [], said{i}{:}));
end
lengths = {99 * ones(2, 1), [6 1], [-1 1], [NaN 1], [2.5 1]};
for i = 1:numel(lengths)
  throws('tokid:shape', sprintf('length: %g found for experiment 1, a whole number from 0 to 5', lengths{i}(1)), ...
         @() tokid.ensemble(ones(2, 5), [], 'length', lengths{i}));
end
lengths = {[3 5 1], 3, 'ab', {'a'}, 1i * [1 1]};
for i = 1:numel(lengths)
  throws('tokid:shape', 'a number for each of 2 experiments', ...
         @() tokid.ensemble(ones(2, 5), [], 'length', lengths{i}));
end
throws('tokid:shape', 'input_names: a value of class double', @() tokid.ensemble(ones(2, 5), [], 'input_names', 5));
data = tokid.ensemble(ones(2, 5), [], 'length', uint8([5 0]), 'dt', single(0.5), 'initial_state', 'unknown');
assert(isequal(data.length, [5; 0]) && isa(data.length, 'double') && isa(data.dt, 'double'));
end

function case_foreign_fields_are_refused()
data = struct('u', ones(3, 4), 'y', ones(3, 4));
names = {'Ts', 'inital_state', 'lenght'};
for i = 1:3
  throws('tokid:option', ['data: the field ', names{i}, ' found, only u, y, dt,'], ...
         @() tokid.validate('absent.npz', setfield(data, names{i}, 1)));
end
silent(@() tokid.write('a.mat', data));
silent(@() tokid.write('b.mat', load('a.mat')));
end

function case_other_orders_of_axes_are_explained()
% Logs of T x channels x N: the calls of the messages give what was meant.
data = tokid.example_data('oscillator', 'experiments', 7, 'steps', 30);
u = permute(data.u, [2 3 1]);
y = permute(data.y, [2 3 1]);
throws('tokid:shape', 'T x channels x N, swap the axes by u = permute(u, [3 1 2]) and y = permute(y, [3 1 2])', ...
       @() tokid.ensemble(u(:, 1, :), y));
throws('tokid:shape', 'If it is N x channels x T, by permute(u, [1 3 2])', @() tokid.ensemble(u(:, 1, :), y));
assert(isequal(permute(u, [3 1 2]), data.u) && isequal(permute(y, [3 1 2]), data.y));
throws('tokid:shape', 'u = permute(u, [2 1]) and y = permute(y, [3 1 2])', @() tokid.ensemble(squeeze(u(:, 1, :)), y));
throws('tokid:shape', 'u = permute(u, [3 1 2]) and y = permute(y, [2 1])', @() tokid.ensemble(u, squeeze(y(:, 1, :))));
throws('tokid:shape', 'give {u} and {y}', @() tokid.ensemble(ones(9, 2), ones(9, 3)));
message = '';
try
  tokid.ensemble(ones(3, 4), ones(3, 5, 2));
catch problem
  message = problem.message;
end
assert(~isempty(message) && isempty(strfind(message, 'permute'))); %#ok<STREMP>
% Equal numbers of channels: the tool tells it.
throws('tokid:input', 'by permute(u, [3 1 2]) and permute(y, [3 1 2]) if the axes are (T, channels, N)', ...
       @() tokid.identify(u, y, 'dt', 0.05, 'lags', 50));
data = tokid.example_data('oscillator', 'experiments', 25, 'steps', 100);
throws('tokid:input', 'by u = permute(u, [2 1 3]) and y = permute(y, [2 1 3])', ...
       @() tokid.identify(permute(data.u, [2 1 3]), permute(data.y, [2 1 3]), 'dt', 0.05, 'lags', 50));
end

function case_iddata()
pkg('load', 'control');
data = tokid.example_data('oscillator', 'experiments', 30, 'steps', 14);
u = cell(30, 1);
y = cell(30, 1);
for i = 1:30
  u{i} = squeeze(data.u(i, :, :));
  y{i} = squeeze(data.y(i, :, :));
end
z = iddata(y, u, 0.05, 'inname', {'torque'; 'force'}, 'outname', {'angle'; 'rate'});
found = tokid.ensemble(z, 'initial_state', 'zero');
assert(isequal(found.u, data.u) && isequal(found.y, data.y) && found.dt == 0.05);
assert(isequal(found.input_names, {'torque'; 'force'}) && isequal(found.output_names, {'angle'; 'rate'}));
assert(strcmp(found.initial_state, 'zero') && ~isfield(found, 'experiment_names') && ~isfield(found, 'input_units'));
model = tokid.identify(z, 'lags', 2, 'states', 4, 'initial_state', 'zero');
expected = tokid.identify(data, 'lags', 2, 'states', 4);
assert(isequal(model.A, expected.A) && model.dt == 0.05);
simulated = tokid.simulate(model, z);
assert(iscell(simulated) && isequal(size(simulated), [30 1]) && isequal(size(simulated{1}), [14 2]));
predicted = tokid.predict(model, z);
near(predicted{3}(4:14, :), y{3}(4:14, :), 1e-6);
tokid.write('a.npz', z);
back = tokid.read('a.npz');
assert(isequal(back.u, data.u));
single = tokid.ensemble(iddata(y{1}, u{1}, 0.1));
assert(isequal(size(single.u), [1 14 2]) && single.dt == 0.1);
z = iddata(y{1}, u{1}, 3);
units = {'', 3; 'seconds', 3; 'milliseconds', 0.003; 'minutes', 180; 'Hours', 10800};
for i = 1:size(units, 1)
  z.timeunit = units{i, 1};
  single = tokid.ensemble(z);
  near(single.dt, units{i, 2}, 1e-15); % rounding
end
z.timeunit = 'months';
throws('tokid:shape', 'an iddata object with the TimeUnit ''months'' found, one of nanoseconds,', ...
       @() tokid.ensemble(z));
single = tokid.ensemble(iddata(y{1}, u{1}));
assert(~isfield(single, 'dt'));
% With uneven SamplingInstants, MATLAB leaves Ts empty. Octave has no such objects.
uneven = struct('Domain', 'Time', 'u', u{1}, 'y', y{1}, 'Ts', [], 'TimeUnit', 'seconds');
throws('tokid:shape', 'an iddata object without Ts found', @() tokid.internal.of_iddata(uneven));
throws('tokid:shape', 'an iddata object with several sample times found', ...
       @() tokid.ensemble(iddata(y(1:2), u(1:2), {0.1; 0.2})));
throws('tokid:shape', 'an iddata object without inputs found', @() tokid.ensemble(iddata(y{1}, [], 0.1)));
end
