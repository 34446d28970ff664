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
throws('tokid:shape', 'y: none found', @() tokid.identify(ones(3, 4), 'dt', 1));
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
