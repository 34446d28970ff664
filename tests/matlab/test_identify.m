function test_identify(name)
% Identification, and what else the tool does with arrays.

% SPDX-License-Identifier: BSD-3-Clause

feval(name);
end

function data = clean_data()
data = tokid.example_data('oscillator', 'experiments', 30, 'steps', 14);
end

function data = noisy_data()
data = tokid.example_data('rotating-tube', 'experiments', 24, 'steps', 12, 'process_noise', 0.05, ...
                          'measurement_noise', 0.05);
end

function case_the_model_of_the_tool_bit_for_bit()
by_tool('example', 'oscillator', '--experiments', '30', '--steps', '14', 'data.mat');
expected = by_tool('identify', 'data.mat', 'model.mat');
data = load('data.mat');
[model, evidence] = tokid.identify(data.u, data.y, 'dt', data.dt, 'initial_state', data.initial_state);
assert(isequaln(rmfield(model, 'options'), rmfield(expected, 'options')));
assert(isequaln(tokid.identify('data.mat'), expected));
assert(isequaln(tokid.identify(tokid.read('data.mat')), expected));
assert(isequal(evidence.output_names, {'y1'; 'y2'}) && evidence.experiments == 30 && isempty(evidence.data));
assert(all(evidence.simulation_fit > 99.99) && isequal(size(evidence.simulation_fit), [2, 1]));
assert(isequal(evidence.warnings, cell(0, 1)));
end

function case_options_arrive()
data = clean_data();
[model, evidence] = tokid.identify(data, 'states', 3, 'lags', 4, 'method', 'subspace', 'frame', 'reference', ...
                                   'reference_step', 5, 'threads', 2, 'nominal', 'none', 'weighting', 'one-step');
assert(evidence.states == 3 && evidence.lags == 4 && strcmp(evidence.method, 'subspace'));
assert(strcmp(model.frame, 'reference') && size(model.A, 1) == 3);
options = jsondecode(model.options);
assert(options.reference_step == 5 && strcmp(options.weighting, 'one-step') && strcmp(options.nominal, 'none'));
[~, evidence] = tokid.identify(data, 'Hold-Out', 0.2, 'initial_state', 'unknown', 'states', 'auto', 'nominal', 'mean');
assert(evidence.held_out_experiments == 6 && strcmp(evidence.evaluated_on, 'held_out') && evidence.nominal);
assert(strcmp(evidence.initial_state, 'unknown'));
end

function case_numbers_arrive_with_all_their_digits()
data = noisy_data();
[model, evidence] = tokid.identify(data, 'smoothing', 1 / 3, 'states', 2, 'lags', 2, 'refine', false);
assert(evidence.smoothing == 1 / 3 && isempty(evidence.refinement));
options = jsondecode(model.options);
assert(options.smoothing == 1 / 3 && strcmp(options.refine, 'no'));
end

function case_invariant_and_periodic()
data = noisy_data();
[model, evidence] = tokid.identify(data, 'time_invariant', true, 'states', 2, 'lags', 3, 'refine', 0);
assert(model.period == 1 && evidence.period == 1 && isequal(model.A(:, :, 1), model.A(:, :, end)));
[~, evidence] = tokid.identify(data, 'smoothing', Inf, 'states', 2, 'lags', 3, 'refine', false);
assert(evidence.period == 1);
model = tokid.identify(data, 'period', 4, 'states', 2, 'lags', 3, 'refine', false, 'time_invariant', false);
options = jsondecode(model.options);
assert(options.period == 4);
throws('tokid:option', '''time_invariant''', @() tokid.identify(data, 'period', 4, 'time_invariant', true));
end

function case_missing_samples_and_unequal_lengths()
data = clean_data();
data.y(3, 5, 1) = NaN;
data.u(4, 11:end, :) = NaN;
data.y(4, 11:end, :) = NaN;
[model, evidence] = tokid.identify(data, 'lags', 2, 'states', 4);
u = cell(30, 1);
y = cell(30, 1);
for i = 1:30
  steps = 1:14 - 4 * (i == 4);
  u{i} = squeeze(data.u(i, steps, :));
  y{i} = squeeze(data.y(i, steps, :));
end
[of_cells, of_cells_evidence] = tokid.identify(u, y, 'dt', data.dt, 'initial_state', 'zero', 'lags', 2, 'states', 4);
assert(evidence.missing_samples == 1 && of_cells_evidence.missing_samples == 1);
assert(isequal(model.A, of_cells.A));
end

function case_names_units_and_free_responses()
data = tokid.example_data('oscillator', 'experiments', 12, 'steps', 14, 'free_responses', 8);
names = {'Größe', 'it''s "b"'};
[model, evidence] = tokid.identify(data.u, data.y, 'dt', 0.05, 'free_y', data.free_y, 'input_names', names, ...
                                   'output_names', {'x', 'y'}, 'output_units', {'m', 'm/s'}, 'initial_state', 'zero');
assert(evidence.free_responses == 8 && isequal(model.input_names, names(:)) && model.dt == 0.05);
assert(isequal(model.output_units, {'m'; 'm/s'}) && isequal(evidence.output_names, {'x'; 'y'}));
assert(model.state_dim(1) == 4);
end

function case_warnings_have_identifiers()
data = noisy_data();
data.y(:, :, 2) = 1;
[~, evidence] = warns('tokid:identify', 'output y2 is constant', ...
                      @() tokid.identify(data, 'states', 2, 'lags', 2, 'refine', false));
assert(any(~cellfun(@isempty, strfind(evidence.warnings, 'output y2 is constant'))));
end

function case_errors_have_the_texts_of_the_tool()
data = clean_data();
throws('tokid:input', 'data: steps: 14 found, lag order 50 needs at least 51', @() tokid.identify(data, 'lags', 50));
throws('tokid:input', 'data: ', @() tokid.identify(data.u, inf(size(data.y))));
throws('tokid:input', 'absent.npz', @() tokid.identify('absent.npz'));
throws('tokid:option', 'option ''lags'': ''x'' found, a whole number from 1 to 1000000 or auto needed', ...
       @() tokid.identify(data, 'lags', 'x'));
throws('tokid:option', 'option ''lags'': ''2.5'' found', @() tokid.identify(data, 'lags', 2.5));
throws('tokid:option', 'identify: option ''lag'' found, one of block, cols, delays, dt,', @() tokid.identify(data, 'lag', 2));
throws('tokid:option', 'option ''lags'' has no value', @() tokid.identify(data, 'lags'));
throws('tokid:option', 'option ''dt'' has no value', @() tokid.identify(data.u, data.y, 'dt'));
throws('tokid:option', 'hold_out, horizons, initial_state, input_names,', @() tokid.identify(data, 'lag', 2)); % once each
throws('tokid:option', 'option ''refine'': true or false needed', @() tokid.identify(data, 'refine', 'perhaps'));
throws('tokid:option', 'a value of class double and size [1 2] found', @() tokid.identify(data, 'lags', [1 2]));
throws('tokid:option', 'option ''dt'' found', @() tokid.identify('absent.npz', 'dt', 2));
end

function case_page_and_state()
data = clean_data();
first = data;
first.u = data.u(1:20, :, :);
first.y = data.y(1:20, :, :);
later = data;
later.u = data.u(21:30, :, :);
later.y = data.y(21:30, :, :);
page = 'the page''s.html';
[model, evidence] = tokid.identify(first, 'lags', 2, 'states', 4, 'state', 'my state.h5', 'report', page);
assert(exist(page, 'file') == 2 && strcmp(evidence.report, page));
[updated, evidence] = tokid.update('my state.h5', later);
assert(evidence.experiments == 30 && evidence.new_experiments == 10);
whole = tokid.identify(data, 'lags', 2, 'states', 4);
near(tokid.simulate(updated, data), tokid.simulate(whole, data), 1e-9);
tokid.report('fresh.html', model, later, 'experiments', 3, 'horizon', 4);
assert(~isempty(strfind(fileread('fresh.html'), '<html'))); %#ok<STREMP>
found = tokid.report('fresh.html', model, later, 'at', [3 7]);
tokid.write('model.npz', model);
tokid.write('later.npz', later);
[~, output] = system(['"', getenv('TOKID'), '" report model.npz later.npz -o p.html --at 3,7 --json 2> said.txt']);
expected = jsondecode(output);
assert(strcmp(found.trust, expected.trust) && strcmp(found.summary, expected.summary));
assert(numel(found.checks) == numel(expected.checks) && iscell(found.reasons));
assert(~isempty(strfind(fileread('fresh.html'), '"starts":[3,7]'))); %#ok<STREMP>
throws('tokid:option', 'option ''at'': ', @() tokid.report('fresh.html', model, later, 'at', -1));
tokid.write('other.npz', whole);
tokid.report('fresh.html', model, later, 'compare', 'other.npz');
assert(~isempty(strfind(fileread('fresh.html'), 'other.npz'))); %#ok<STREMP>
tokid.report('fresh.html', model, later, 'compare', {'other.npz', whole, model});
page = fileread('fresh.html');
assert(all(cellfun(@(name) ~isempty(strfind(page, name)), {'other.npz', 'other_2.mat', 'other_3.mat'}))); %#ok<STREMP>
tokid.report('fresh.html', model, later, 'compare', whole);
assert(~isempty(strfind(fileread('fresh.html'), 'other_1.mat'))); %#ok<STREMP>
throws('tokid:input', 'absent.npz', @() tokid.report('fresh.html', model, later, 'compare', {'other.npz', 'absent.npz'}));
throws('tokid:input', 'extension', @() tokid.report('fresh.txt', model, later));
end

function case_arrays_have_the_sample_time_of_model_or_state()
data = clean_data();
assert(data.dt == 0.05);
state = 'it''s a state.h5';
model = tokid.identify(data.u(1:20, :, :), data.y(1:20, :, :), 'dt', data.dt, 'lags', 2, 'states', 4, 'state', state);
silent(@() tokid.update(state, data.u(21:29, :, :), data.y(21:29, :, :)));
throws('tokid:input', 'dt: 0.1 found, 0.05 needed', ...
       @() tokid.update(state, data.u, data.y, 'dt', 0.1));
throws('tokid:input', 'absent.h5', @() tokid.update('absent.h5', data.u, data.y));
tokid.write('m.npz', model);
throws('tokid:input', 'm.npz', @() tokid.update('m.npz', data.u, data.y));
expected = silent(@() tokid.predict(model, data.u, data.y));
assert(isequaln(silent(@() tokid.predict('m.npz', data.u, data.y)), expected));
assert(isequaln(silent(@() tokid.predict('m.npz', struct('u', data.u, 'y', data.y, 'dt', []))), expected));
warns('tokid:predict', 'dt = 0.1 s', @() tokid.predict('m.npz', data.u, data.y, 'dt', 0.1));
throws('tokid:input', 'absent.npz', @() tokid.predict('absent.npz', data.u, data.y));
end

function case_blocks_of_a_large_file()
tokid.write('data.h5', tokid.example_data('oscillator', 'experiments', 40, 'steps', 120));
[model, evidence] = tokid.identify('data.h5', 'block', 40);
assert(evidence.block == 40 && evidence.states == 4 && size(model.A, 3) == 120);
end

function case_refinement()
data = noisy_data();
start = tokid.identify(data, 'states', 2, 'lags', 2, 'refine', false);
[model, evidence] = warns('tokid:refine', 'not converged', ...
                          @() tokid.refine(start, data, 'iterations', 3, 'smoothing', 0.1, 'threads', 1));
assert(evidence.iterations == 3 && evidence.smoothing == 0.1 && isequal(size(model.Q), [2, 2, 12]));
assert(all(diff(evidence.penalised_log_likelihood) >= 0));
[~, evidence] = warns('tokid:refine', 'not converged', ...
                      @() tokid.refine(start, data, 'iterations', 1, 'smoothing', Inf));
assert(evidence.smoothing == Inf);
without = warns('tokid:refine', 'not converged', ...
                @() tokid.refine(start, data, 'iterations', 1, 'smoothing', 0.1, 'feedthrough', false));
assert(all(without.D(:) == 0));
tokid.write('start.npz', start);
tokid.write('data.npz', data);
again = warns('tokid:refine', 'not converged', ...
              @() tokid.refine('start.npz', 'data.npz', 'iterations', 3, 'smoothing', 0.1));
assert(isequal(again.A, model.A));
end

function case_validation()
data = clean_data();
model = tokid.identify(data, 'lags', 2, 'states', 3);
evidence = tokid.validate(model, data.u, data.y, 'horizon', 3, 'initial_state', 'zero');
simulated = tokid.simulate(model, data);
for j = 1:2
  y = data.y(:, :, j);
  misfit = y - simulated(:, :, j);
  expected = 100 * (1 - norm(misfit(:)) / norm(y(:) - mean(y(:))));
  assert(abs(evidence.simulation_fit(j) - expected) < 1e-8);
end
assert(evidence.horizon == 3 && isempty(evidence.cross_validation));
evidence = tokid.validate(model, data, 'cross_validate', 3);
assert(evidence.cross_validation.folds == 3 && numel(evidence.cross_validation.per_fold) == 3);
end

function case_intervals()
data = tokid.example_data('rotating-tube', 'experiments', 60, 'steps', 12, 'measurement_noise', 0.02);
model = tokid.identify(data, 'method', 'tvera', 'states', 2, 'lags', 2, 'smoothing', 0);
[bounds, evidence] = tokid.confidence(model, data, 'level', 0.9, 'band', 4);
assert(evidence.level == 0.9 && isequal(size(bounds.markov), [1, 1, 5, size(model.A, 3)]));
assert(all(bounds.simulated_lower(:) <= bounds.simulated_upper(:)));
near(bounds.markov(:, :, 2, 6), model.C(:, :, 6) * model.B(:, :, 5), 0.5);
end

function case_modes()
data = tokid.example_data('rotating-tube', 'experiments', 60, 'steps', 12, 'measurement_noise', 0.02);
model = tokid.identify(data, 'method', 'tvera', 'states', 2, 'lags', 2, 'smoothing', 0);
found = tokid.modes(model, 'window', 4);
assert(found.window == 4 && isequal(size(found.frequency), size(found.valid)) && size(found.valid, 2) == 2);
near(found.frequency, abs(found.poles_real + 1i * found.poles_imag), 1e-12);
sure = tokid.modes(model, data, 'window', 4, 'replicates', 5, 'level', 0.9);
near(sure.frequency, found.frequency, 1e-12);
assert(sure.level == 0.9 && all(sure.frequency_lower(:) <= sure.frequency_upper(:)));
throws('tokid:option', 'option ''replicates'' found without data', @() tokid.modes(model, 'replicates', 5));
throws('tokid:option', 'option ''windw'' found', @() tokid.modes(model, 'windw', 4));
throws('tokid:option', 'option ''windw'' found', @() tokid.modes(model, data, 'windw', 4));
throws('tokid:option', 'option ''window'' has no value', @() tokid.modes(model, 'window'));
file = 'data.npz';
tokid.write(file, data);
of_file = tokid.modes(model, file, 'window', 4, 'replicates', 5, 'level', 0.9);
near(of_file.frequency_upper, sure.frequency_upper, 1e-12);
end

function case_plans()
[data, evidence] = tokid.plan('states', 4, 'inputs', 2, 'outputs', 2, 'steps', 20, 'amplitude', [0.5 2], ...
                              'experiments', 12, 'noise', [0 0], 'dt', 0.1);
assert(isequal(size(data.u), [12, 20, 2]) && ~isfield(data, 'y') && data.dt == 0.1);
assert(evidence.minimum == 10 && iscell(evidence.reasons));
assert(max(max(abs(data.u(:, :, 1)))) <= 0.5 && max(max(abs(data.u(:, :, 2)))) > 0.5);
model = tokid.identify(clean_data(), 'lags', 2, 'states', 4);
[data, evidence] = tokid.plan('model', model, 'kind', 'binary', 'seed', 3);
assert(size(data.u, 2) == 14 && strcmp(evidence.kind, 'binary') && numel(evidence.rank) == 14);
throws('tokid:option', '''states''', @() tokid.plan('inputs', 2));
end

function case_the_tool_is_looked_for()
tool = getenv('TOKID');
assert(strcmp(tokid.tool(), tool));
throws('tokid:toolNotFound', 'no/such/tool: no such file', @() tokid.tool('no/such/tool'));
setenv('TOKID', '/no/such/tool');
throws('tokid:toolNotFound', 'environment variable TOKID', @() tokid.example_data('oscillator'));
[~, link] = fileparts(tool);
tokid.tool(tool);
assert(strcmp(tokid.tool(), tool) && strcmp(link, 'tokid'));
tokid.tool('');
setenv('TOKID', '');
setenv('PATH', [fileparts(tool), ':', getenv('PATH')]);
assert(exist(tokid.tool(), 'file') == 2);
end

function case_the_tool_stays_when_the_folder_changes()
tool = getenv('TOKID');
[folder, name] = fileparts(tool);
here = pwd();
ways = {@() tokid.tool(name), @() setenv('TOKID', name), @() setenv('PATH', ['.:', getenv('PATH')])};
for i = 1:3
  cd(folder);
  setenv('TOKID', '');
  ways{i}();
  assert(strcmp(tokid.tool(), fullfile(folder, name)));
  cd(here);
  assert(strcmp(tokid.tool(), fullfile(folder, name)));
  tokid.tool('');
end
setenv('TOKID', name);
throws('tokid:toolNotFound', 'environment variable TOKID', @() tokid.tool());
cd(folder);
assert(strcmp(tokid.tool(), fullfile(folder, name)));
tokid.tool(tool);
throws('tokid:toolNotFound', 'no such file', @() tokid.tool('no/such/tool'));
throws('tokid:input', 'the name of a file needed, 1 x 1 of class double found', @() tokid.tool(5));
assert(strcmp(tokid.tool(), tool)); % after a wrong one, that of before
end

function case_another_program_is_no_tool()
tokid.tool('/bin/false');
throws('tokid:tool', '/bin/false ended with status 1', @() tokid.example_data('oscillator'));
id = fopen('dies', 'w');
fprintf(id, '#!/bin/sh\necho "tokid: out of memory" >&2\nkill -9 $$\n');
fclose(id);
system('chmod +x dies');
tokid.tool(fullfile(pwd(), 'dies'));
throws('tokid:tool', 'status', @() tokid.example_data('oscillator'));
id = fopen('fails', 'w');
fprintf(id, '#!/bin/sh\necho "tokid: out of memory" >&2\nexit 1\n');
fclose(id);
system('chmod +x fails');
tokid.tool(fullfile(pwd(), 'fails'));
throws('tokid:failed', 'out of memory', @() tokid.example_data('oscillator'));
tokid.tool('');
end

function case_reports_of_the_tool_are_shown()
data = clean_data();
shown = evalc('model = tokid.identify(data, ''lags'', 2, ''states'', 4, ''print'', true);');
assert(~isempty(regexp(shown, '(^|\n)Data +data: 30 experiments', 'once')));
assert(~isempty(regexp(shown, '\nVerdict +good', 'once')) && isempty(strfind(shown, tempdir()))); %#ok<STREMP>
expected = tokid.identify(data, 'lags', 2, 'states', 4);
assert(isequal(model.A, expected.A));
assert(isempty(evalc('tokid.identify(data, ''lags'', 2, ''states'', 4, ''print'', false);')));
shown = evalc('tokid.validate(model, data);');
assert(~isempty(regexp(shown, '(^|\n)Model +model\n', 'once')) && ~isempty(regexp(shown, '\nVerdict +good', 'once')));
fresh = tokid.example_data('oscillator', 'experiments', 30, 'steps', 14, 'seed', 3);
shown = evalc('tokid.validate(model, fresh);');
assert(~isempty(regexp(shown, '\nNext +use the model\s*$', 'once')), shown);
small = tokid.example_data('oscillator', 'experiments', 8, 'steps', 14, 'measurement_noise', 0.3);
shown = evalc('tokid.identify(small, ''refine'', false, ''print'', true);');
assert(~isempty(regexp(shown, '\nNext +measure more experiments\s*$', 'once')), shown);
assert(isempty(evalc('evidence = tokid.validate(model, data);')) && evidence.experiments == 30);
assert(~isempty(evidence.verdict.summary) && isequal(evidence.verdict.reasons, cell(0, 1)));
tokid.identify(data, 'lags', 2, 'states', 4, 'state', 'rig.h5');
later = tokid.example_data('oscillator', 'experiments', 5, 'steps', 14, 'seed', 2);
shown = evalc('tokid.update(''rig.h5'', later, ''print'', true);');
assert(~isempty(regexp(shown, '\nWritten +rig.h5\n +model\n', 'once')));
data = noisy_data();
start = tokid.identify(data, 'states', 2, 'lags', 2, 'refine', false);
shown = evalc('tokid.refine(start, data, ''smoothing'', 0.1, ''iterations'', 2, ''print'', true);');
assert(~isempty(regexp(shown, '\nWritten +model', 'once')));
throws('tokid:option', 'option ''print'' found beside the result evidence', @() two_results(data));
throws('tokid:option', 'option ''print'': true or false needed', @() tokid.identify(data, 'print', 'yes'));
end

function two_results(data)
[~, ~] = tokid.identify(data, 'print', true);
end

function case_names_of_compared_models()
data = clean_data();
model = tokid.identify(data, 'lags', 2, 'states', 4);
other = tokid.identify(data, 'lags', 2, 'states', 3);
tokid.write('file.npz', other);
tokid.report('a.html', model, data, 'compare', {other, 'file.npz'}, 'compare_names', {'three states', 'of a/file'});
page = fileread('a.html');
assert(~isempty(strfind(page, '"models":["model.mat","three states.mat","of a_file.mat"]'))); %#ok<STREMP>
tokid.report('a.html', 'file.npz', data, 'compare', model, 'compare_names', {'three', 'four'});
page = fileread('a.html');
assert(~isempty(strfind(page, '"models":["three.mat","four.mat"]'))); %#ok<STREMP>
wrong = {{'a', 'b', 'c'}, {'a', 'a'}, {'a', ''}, 5};
for i = 1:numel(wrong)
  throws('tokid:option', 'report: option ''compare_names''', ...
         @() tokid.report('b.html', model, data, 'compare', {other}, 'compare_names', wrong{i}));
end
throws('tokid:option', '1 names found beside 0 models', ...
       @() tokid.report('b.html', model, data, 'compare_names', {'a'}));
assert(exist('b.html', 'file') == 0);
end

function case_bands_of_arrays()
data = tokid.example_data('rotating-tube', 'experiments', 24, 'steps', 12, 'measurement_noise', 0.05);
model = tokid.identify(data, 'states', 2, 'lags', 2, 'refine', false);
tokid.write('training.npz', data);
fresh = tokid.example_data('rotating-tube', 'experiments', 6, 'steps', 12, 'measurement_noise', 0.05, 'seed', 2);
tokid.report('a.html', model, fresh, 'bands', data);
tokid.report('b.html', model, fresh, 'bands', 'training.npz');
found = bands_of('a.html');
assert(numel(found) > 100 && isequal(found, bands_of('b.html')));
tokid.report('c.html', model, fresh);
assert(isempty(bands_of('c.html')));
end

function text = bands_of(page)
text = regexp(fileread(page), '"bands":\{[^}]*\}', 'match', 'once');
end

function case_rows_of_modes()
% Row i belongs to step begin + i - 1, here found by a jump.
model = struct('A', reshape([0.5 * ones(1, 10), 0.8 * ones(1, 10)], 1, 1, 20), 'B', ones(1, 1, 20), ...
               'C', ones(1, 1, 20), 'D', zeros(1, 1, 20), 'G', zeros(1, 1, 20), 'state_dim', ones(21, 1), 'k_begin', 3);
found = tokid.modes(model, 'window', 4);
assert(isequal(size(found.valid), [16 1]) && found.begin == 5);
poles = exp(found.poles_real * found.dt);
i = find(poles > 0.55, 1);
assert(model.A(:, :, found.begin + i - model.k_begin) == 0.8);
assert(model.A(:, :, found.begin + i - 1 - model.k_begin) == 0.5);
end
