// Everything: from repeated experiments to a time varying state-space model with its observer.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/design.hpp"
#include "tokid/ensemble.hpp"
#include "tokid/example.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/identify.hpp"
#include "tokid/io.hpp"
#include "tokid/linalg.hpp"
#include "tokid/markov.hpp"
#include "tokid/model.hpp"
#include "tokid/observer.hpp"
#include "tokid/paper.hpp"
#include "tokid/parallel.hpp"
#include "tokid/report.hpp"
#include "tokid/tvera.hpp"
#include "tokid/validate.hpp"
#include "tokid/version.hpp"
