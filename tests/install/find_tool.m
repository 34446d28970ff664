% The functions that were installed find the tool that was installed with them, without TOKID and PATH.
% SPDX-License-Identifier: BSD-3-Clause
addpath(getenv('MATLAB_FOLDER'));
setenv('TOKID', '');
setenv('PATH', '/usr/bin:/bin');
data = tokid.example_data('oscillator', 'experiments', 3, 'steps', 4);
fprintf('%d experiments by %s\n', size(data.u, 1), tokid.tool());
