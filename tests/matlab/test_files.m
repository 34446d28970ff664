function test_files(name)
% Files in every format, and names of files that a shell would misunderstand.

% SPDX-License-Identifier: BSD-3-Clause

feval(name);
end

function data = full_ensemble()
data = tokid.ensemble(randn(4, 6, 2), randn(4, 6, 3), 'dt', 0.05, 'length', [6 3 5 0], 'free_y', randn(2, 5, 3), ...
                      'initial_state', 'unknown', 'input_names', {'Größe ϑ', 'a "b"'}, ...
                      'output_names', {'x', 'it''s', 'z'}, 'input_units', {'N', 'V'}, 'output_units', ...
                      {'m', '', '°'}, 'experiment_names', {'17', 'after lunch', 'Größe', '4'});
data.y(1, 3, 2) = NaN;
for i = 1:4
  data.u(i, data.length(i) + 1:end, :) = NaN;
  data.y(i, data.length(i) + 1:end, :) = NaN;
end
end

function model = small_model()
data = tokid.example_data('oscillator', 'experiments', 20, 'steps', 12);
model = tokid.identify(data, 'lags', 2, 'states', 4);
end

function case_ensembles_come_back()
data = full_ensemble();
files = {'a.mat', 'a.npz', 'a.h5', 'a.hdf5'};
for i = 1:numel(files)
  tokid.write(files{i}, data);
  assert(isequaln(orderfields(tokid.read(files{i})), orderfields(data)), files{i});
end
data = rmfield(data, 'free_y');
tokid.write('a.csv', data);
assert(isequaln(orderfields(tokid.read('a.csv')), orderfields(data)));
end

function case_ensembles_in_mat73_come_back()
data = full_ensemble();
tokid.write('a.mat', data, 'mat73', true);
assert(isequaln(orderfields(tokid.read('a.mat')), orderfields(data)));
throws('tokid:option', '''mat73''', @() tokid.write('a.npz', data, 'mat73', true));
end

function case_names_of_experiments()
data = tokid.ensemble(randn(3, 6), randn(3, 6), 'experiment_names', [17 4 0.5]);
assert(isequal(data.experiment_names, {'17'; '4'; '0.5'}));
tokid.write('a.csv', data);
text = fileread('a.csv');
assert(~isempty(strfind(text, sprintf('\n17,')))); %#ok<STREMP>
back = tokid.read('a.csv');
assert(isequal(back.experiment_names, data.experiment_names));
throws('tokid:shape', 'experiment_names: 2 found, a name for each of 3 experiments needed', ...
       @() tokid.ensemble(randn(3, 6), randn(3, 6), 'experiment_names', {'a', 'b'}));
throws('tokid:input', 'experiment_names: "a" found at rows 0 and 2', ...
       @() tokid.write('b.npz', tokid.ensemble(randn(3, 6), randn(3, 6), 'experiment_names', {'a', 'b', 'a'})));
data.u(2, 3) = Inf;
data.dt = 1;
throws('tokid:input', 'infinite value in experiment "4" (row 1) at step 2', @() tokid.identify(data));
end

function case_models_come_back()
model = small_model();
files = {'a.mat', 'a.npz', 'a.h5'};
for i = 1:numel(files)
  tokid.write(files{i}, model);
  assert(isequaln(orderfields(tokid.read(files{i})), orderfields(model)), files{i});
end
end

function case_one_channel_one_step_one_experiment()
% MATLAB drops trailing dimensions of size one.
sizes = {[3 5], [1 5], [5 1]};
for i = 1:2
  data = tokid.ensemble(randn(sizes{i}), randn(sizes{i}));
  tokid.write('a.npz', data);
  back = tokid.read('a.npz');
  assert(isequal(back.u, data.u) && isequal(back.y, data.y));
end
model = struct('A', [0.5 0; 0 0.2], 'B', [1; 1], 'C', [1 0], 'D', 0.5, 'G', [0; 0], 'state_dim', [2; 2]);
tokid.write('m.npz', model);
back = tokid.read('m.npz');
names = fieldnames(model);
for i = 1:numel(names)
  assert(isequal(back.(names{i}), model.(names{i})), names{i});
end
end

function case_a_model_loads_as_plain_arrays_of_natural_shapes()
data = tokid.example_data('oscillator', 'experiments', 40, 'steps', 12, 'measurement_noise', 0.1);
model = tokid.refine(tokid.identify(data, 'states', 3, 'lags', 4, 'nominal', 'mean', 'refine', false), data, ...
                     'iterations', 2);
tokid.write('model.npz', model);
plain = by_tool('convert', 'model.npz', 'model.mat');
n = 3; r = 2; m = 2; S = 12;
shapes = struct('A', [n n S], 'B', [n r S], 'C', [m n S], 'D', [m r S], 'G', [n m S], 'Q', [n n S], 'R', [m m S], ...
                'K', [n m S], 'innovation_cov', [m m S], 'state_dim', [S + 1, 1], 'u_nominal', [12 r], ...
                'y_nominal', [12 m], 'k_begin', [1 1], 'dt', [1 1], 'lags', [S 1], 'condition', [S 1], 'rank', [S 1]);
names = fieldnames(shapes);
for i = 1:numel(names)
  assert(isa(plain.(names{i}), 'double') && isequal(size(plain.(names{i})), shapes.(names{i})), names{i});
end
assert(ischar(plain.method) && size(plain.method, 1) == 1);
assert(isequaln(orderfields(plain), orderfields(model)));
end

function case_columns_of_a_table()
id = fopen('a.csv', 'w');
fprintf(id, 'experiment,time,torque,angle\n0,0,1,2\n0,0.5,3,4\n1,0,5,6\n1,0.5,7,\n');
fclose(id);
data = tokid.read('a.csv', 'inputs', {'torque'}, 'outputs', 'angle');
assert(data.dt == 0.5 && isequal(data.u, [1 3; 5 7]) && isequaln(data.y, [2 4; 6 NaN]));
throws('tokid:input', 'a.csv', @() tokid.read('a.csv', 'inputs', {'force'}, 'outputs', {'angle'}));
end

function case_strange_names_of_files()
data = tokid.ensemble(randn(3, 4), randn(3, 4));
names = {'it''s "so"', '$HOME;`id`', 'a&b|c <d>', '*?[a]', '%d\n\\', '-o', '--help', 'Größe', '(x)#!{y}'};
for i = 1:numel(names)
  mkdir(['dir ', names{i}]);
  files = {fullfile(['dir ', names{i}], [names{i}, '.npz']), [names{i}, '.npz']};
  for j = 1:2
    tokid.write(files{j}, data);
    back = tokid.read(files{j});
    assert(isequal(back.u, data.u), files{j});
  end
end
end

function case_names_are_no_commands()
data = tokid.ensemble(randn(3, 4), randn(3, 4));
names = {'a''; touch owned; ''.npz', 'a$(touch owned).npz', '`touch owned`.npz', 'a" ; touch owned ; ".npz', ...
         sprintf('a\ntouch owned\n.npz')};
for i = 1:numel(names)
  tokid.write(names{i}, data);
  tokid.read(names{i});
end
throws('tokid:option', '; touch owned', @() tokid.identify(data, 'method', 'x''; touch owned; '''));
assert(exist('owned', 'file') == 0);
end

function case_home_is_understood()
setenv('HOME', pwd());
tokid.write('~/in home.npz', tokid.ensemble(randn(3, 4), randn(3, 4)));
assert(exist(fullfile(pwd(), 'in home.npz'), 'file') == 2);
end

function case_what_is_wrong_with_a_file()
throws('tokid:input', 'the name of a file needed, 1 x 1 of class double found', @() tokid.read(5));
throws('tokid:input', '0 x 0 of class char', @() tokid.read(''));
throws('tokid:input', '2 x 1 of class char', @() tokid.write(['a'; 'b'], tokid.ensemble(1, 1)));
throws('tokid:input', 'absent.npz', @() tokid.read('absent.npz'));
id = fopen('broken.npz', 'w');
fprintf(id, 'nothing');
fclose(id);
throws('tokid:input', 'broken.npz', @() tokid.read('broken.npz'));
throws('tokid:input', 'a.xyz: extension ''.xyz'' found', @() tokid.write('a.xyz', tokid.ensemble(1, 1)));
throws('tokid:input', 'no/such/folder', @() tokid.write('no/such/folder/a.npz', tokid.ensemble(1, 1)));
throws('tokid:option', 'write: option ''mat7'' found, one of mat73 needed', ...
       @() tokid.write('a.mat', tokid.ensemble(1, 1), 'mat7', true));
end

function case_what_is_wrong_with_a_model()
throws('tokid:model', 'the field B, C, D, G, state_dim is missing', @() tokid.write('a.npz', struct('A', 1)));
throws('tokid:model', 'a value of class double found', @() tokid.predict(1, ones(3, 4), ones(3, 4)));
model = small_model();
model.B = model.B(1:3, :, :);
throws('tokid:model', 'model: B: 3 x 2 x 12 found, 4 x 2 x 12 needed beside A of 4 x 4 x 12', ...
       @() tokid.write('a.npz', model));
model = small_model();
model.G = model.G(:, 1, :);
throws('tokid:model', 'model: G: 4 x 1 x 12 found', @() tokid.predict(model, ones(2, 12, 2), ones(2, 12, 2)));
end

function case_quotation_marks_of_cmd()
% Windows is not at hand, its rules are known.
assert(strcmp(tokid.internal.quote('C:\a b\c.mat', true), '"C:\a b\c.mat"'));
assert(strcmp(tokid.internal.quote('C:\a b\', true), '"C:\a b\\"'));
assert(strcmp(tokid.internal.quote('a & b | c', true), '"a & b | c"'));
throws('tokid:quote', '%PATH%', @() tokid.internal.quote('%PATH%', true));
throws('tokid:quote', 'a"b', @() tokid.internal.quote('a"b', true));
assert(strcmp(tokid.internal.quote('it''s', false), '''it''\''''s'''));
end

function case_libraries_of_matlab_are_left_out()
assert(strcmp(tokid.internal.without('/m/R1/bin:/usr/lib:/m/R1:/m/R10/x', '/m/R1', ':'), '/usr/lib:/m/R10/x'));
assert(isempty(tokid.internal.without('', '/m/R1', ':')));
end

function case_structs_saved_as_variables()
model = small_model();
data = tokid.example_data('oscillator', 'experiments', 4, 'steps', 12);
save('-v7', 'mm.mat', 'model');
save('-v7', 'dd.mat', 'data');
throws('tokid:input', 'The variable ''model'' of mm.mat is a struct, but its fields must be the variables', ...
       @() tokid.validate('mm.mat', data));
throws('tokid:input', 'Write it by tokid.write(''dd.mat'', data), or by save with the option ''-struct''', ...
       @() tokid.validate(model, 'dd.mat'));
tokid.write('dd.mat', data);
save('-v7', 'mm.mat', '-struct', 'model');
evidence = tokid.validate('mm.mat', 'dd.mat');
assert(evidence.experiments == 4);
end

function case_messages_in_the_terms_of_matlab()
said = {'--output-weight: 4 numbers found', 'option ''output_weight'': 4 numbers found'; ...
        'State --period P, or --no-refine', 'State ''period'' P, or ''refine'', false'; ...
        'try one; see ''tokid lqr --help''', 'try one; see ''help tokid.lqr'''; ...
        'state --inputs ''A,B'' --outputs ''C,D''', 'state ''inputs'', {''A'', ''B''}, ''outputs'', {''C'', ''D''}'; ...
        'a note (5 with --verbose)', 'a note (5 with --verbose)'; ...
        'Use the order (experiments, steps, channels), not (experiments, channels, steps)', ...
        ['Use the order (experiments, steps, channels), not (experiments, channels, steps). Reorder the axes by ' ...
         'permute(u, [1 3 2]) and permute(y, [1 3 2]), or by permute(u, [3 1 2]) and permute(y, [3 1 2]) if the ' ...
         'axes are (T, channels, N)']; ...
        'Use the order (experiments, steps, channels), not (steps, experiments, channels)', ...
        ['Use the order (experiments, steps, channels), not (steps, experiments, channels). Reorder the axes by ' ...
         'u = permute(u, [2 1 3]) and y = permute(y, [2 1 3])']; ...
        '--help.npz: no such file', '--help.npz: no such file'; ...
        './--x/a b--c: no such file', './--x/a b--c: no such file'};
for i = 1:size(said, 1)
  found = tokid.internal.in_matlab(said{i, 1});
  assert(strcmp(found, said{i, 2}), found);
end
end

function case_options_of_all_functions()
% The functions have only options that their commands have. Messages show these options as in MATLAB.
m = struct('A', 1, 'B', 1, 'C', 1, 'D', 1, 'G', 1, 'state_dim', [1; 1]);
calls = {'identify', {'d.npz'}; 'refine', {m, 'd.npz'}; 'update', {'s.h5', 'd.npz'}; 'validate', {m, 'd.npz'}; ...
         'confidence', {m, 'd.npz'}; 'modes', {m, 'd.npz'}; 'predict', {m, 'd.npz'}; 'plan', {}; 'lqr', {m}; ...
         'learn', {m, 1, 1, 1}; 'export', {'a.c', m}; 'report', {'a.html', m, 'd.npz'}; 'example', {'oscillator'}; ...
         'convert', {'a.npz'}};
names = {'example', 'example_data'; 'convert', 'read'};
for i = 1:size(calls, 1)
  name = calls{i, 1};
  if any(strcmp(name, names(:, 1)))
    name = names{strcmp(name, names(:, 1)), 2};
  end
  message = '';
  try
    feval(['tokid.', name], calls{i, 2}{:}, 'no_such_option', 1);
  catch problem
    message = problem.message;
  end
  options = regexp(message, 'option ''no_such_option'' found, one of (.*) needed', 'tokens', 'once');
  options = setdiff(strsplit(options{1}, ', '), {'print', 'compare_names'});
  [~, help_text] = system(['"', getenv('TOKID'), '" ', calls{i, 1}, ' --help']);
  assert(numel(options) >= 2);
  for j = 1:numel(options)
    option = ['--', strrep(options{j}, '_', '-')];
    assert(~isempty(regexp(help_text, ['\n  ', option, '\s'], 'once')), '%s: %s', name, option);
    found = tokid.internal.in_matlab(['try ', option]);
    assert(strcmp(found, ['try ''', options{j}, '''']), found);
  end
end
end
