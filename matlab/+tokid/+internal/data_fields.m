function names = data_fields()
% What may be said of data by name and value, wherever they are given as arrays.

% SPDX-License-Identifier: BSD-3-Clause

names = {'dt', 'length', 'free_y', 'initial_state', 'input_names', 'output_names', 'input_units', 'output_units', ...
         'experiment_names'};
end
