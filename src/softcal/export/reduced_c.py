"""A reduced model as one C99 file without dependencies, by the formulas of `reduced_model.py`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

_CODE = """\
/* Reduced model of a robot, written by softcal. C99, no dependencies but sqrt of <math.h>.

   int reduced_model(const double input[N_INPUTS], double output[N_OUTPUTS], double jacobian[N_ROWS * N_INPUTS]);

   Returns 0, or k where the k-th input, from 1, is outside its range; then nothing is written.
   input:    @INPUTS@
   output:   @OUTPUTS@
             (a pose is x, y, z [m] and the quaternion x, y, z, w of the rotation from rest)
   jacobian: rows, each by the inputs; NULL where it is not wanted:
             @ROWS@
             (.rx .ry .rz [rad] are small rotations about the world's axes) */
#include <math.h>
#include <stddef.h>

enum { N_INPUTS = @N_INPUTS@, N_TERMS = @N_TERMS@, DEGREE = @DEGREE@, N_PLATES = @N_PLATES@,
       N_OUTPUTS = @N_OUTPUTS@, N_ROWS = @N_ROWS@ };

static const double LEAST[N_INPUTS] = @LEAST@;
static const double MOST[N_INPUTS] = @MOST@;
static const double DIRECTIONS[N_INPUTS][N_INPUTS] = @DIRECTIONS@;
static const unsigned char POWERS[N_TERMS][N_INPUTS] = @POWERS@;
static const double COEFFICIENTS[N_TERMS][N_OUTPUTS] = @COEFFICIENTS@;

int reduced_model(const double input[], double output[], double jacobian[]) {
  double T[N_INPUTS][DEGREE + 1], D[N_INPUTS][DEGREE + 1], by[N_INPUTS][N_OUTPUTS], rate[N_INPUTS][N_OUTPUTS];
  for (int k = 0; k < N_INPUTS; ++k)
    if (!(LEAST[k] <= input[k] && input[k] <= MOST[k])) return k + 1;
  for (int k = 0; k < N_INPUTS; ++k) { /* Chebyshev polynomials T, and their derivatives n U_(n-1) */
    double s = 0.0, before = 0.0, U = 1.0;
    for (int j = 0; j < N_INPUTS; ++j)
      s += DIRECTIONS[k][j] * ((input[j] - 0.5 * (MOST[j] + LEAST[j])) / (0.5 * (MOST[j] - LEAST[j])));
    T[k][0] = 1.0;
    D[k][0] = 0.0;
    for (int n = 1; n <= DEGREE; ++n) {
      const double next = 2.0 * s * U - before;
      T[k][n] = n == 1 ? s : 2.0 * s * T[k][n - 1] - T[k][n - 2];
      D[k][n] = n * U;
      before = U;
      U = next;
    }
  }
  for (int i = 0; i < N_OUTPUTS; ++i) {
    output[i] = 0.0;
    for (int k = 0; k < N_INPUTS; ++k) by[k][i] = rate[k][i] = 0.0;
  }
  for (int m = 0; m < N_TERMS; ++m) {
    double after[N_INPUTS + 1], before = 1.0;
    after[N_INPUTS] = 1.0;
    for (int k = N_INPUTS - 1; k >= 0; --k) after[k] = after[k + 1] * T[k][POWERS[m][k]];
    for (int i = 0; i < N_OUTPUTS; ++i) output[i] += after[0] * COEFFICIENTS[m][i];
    for (int k = 0; jacobian != NULL && k < N_INPUTS; ++k) {
      const double weight = before * D[k][POWERS[m][k]] * after[k + 1];
      if (weight != 0.0)
        for (int i = 0; i < N_OUTPUTS; ++i) by[k][i] += weight * COEFFICIENTS[m][i];
      before *= T[k][POWERS[m][k]];
    }
  }
  for (int k = 0; jacobian != NULL && k < N_INPUTS; ++k) /* from directions to inputs */
    for (int j = 0; j < N_INPUTS; ++j) {
      const double weight = DIRECTIONS[j][k] / (0.5 * (MOST[k] - LEAST[k]));
      for (int i = 0; i < N_OUTPUTS; ++i) rate[k][i] += weight * by[j][i];
    }
  for (int p = 0; p < N_PLATES; ++p) {
    double *q = output + 7 * p + 3;
    const double size = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; ++i) q[i] /= size;
    for (int k = 0; jacobian != NULL && k < N_INPUTS; ++k) {
      const double *r = rate[k] + 7 * p, *d = r + 3;
      double *row = jacobian + 6 * p * N_INPUTS + k;
      for (int i = 0; i < 3; ++i) row[i * N_INPUTS] = r[i];
      row[3 * N_INPUTS] = 2.0 / size * (q[3] * d[0] - q[0] * d[3] + q[1] * d[2] - q[2] * d[1]);
      row[4 * N_INPUTS] = 2.0 / size * (q[3] * d[1] - q[1] * d[3] + q[2] * d[0] - q[0] * d[2]);
      row[5 * N_INPUTS] = 2.0 / size * (q[3] * d[2] - q[2] * d[3] + q[0] * d[1] - q[1] * d[0]);
    }
  }
  for (int i = 7 * N_PLATES; jacobian != NULL && i < N_OUTPUTS; ++i)
    for (int k = 0; k < N_INPUTS; ++k) jacobian[(i - N_PLATES) * N_INPUTS + k] = rate[k][i];
  return 0;
}
"""


def c_source(model: Mapping[str, Any]) -> str:
    """The source of a model; its numbers are those of `model.json` to the last digit."""
    inputs, plates = model["inputs"], model["plates"]
    outputs = [*(f"pose of {name}" for name in plates), *model["coordinates"]]
    outputs += [f"{name}.{axis}" for name in model["markers"] for axis in "xyz"]
    powers, coefficients = np.array(model["powers"]), np.array(model["coefficients"])
    values = {
        "INPUTS": _listed(f"{one['name']} [{one['unit']}]" for one in inputs),
        "OUTPUTS": _listed(outputs),
        "ROWS": _listed(model["rows"]),
        "N_INPUTS": str(len(inputs)),
        "N_TERMS": str(len(powers)),
        "DEGREE": str(max(int(powers.max()), 1)),
        "N_PLATES": str(len(plates)),
        "N_OUTPUTS": str(coefficients.shape[1]),
        "N_ROWS": str(len(model["rows"])),
        "LEAST": _numbers([one["least"] for one in inputs]),
        "MOST": _numbers([one["most"] for one in inputs]),
        "DIRECTIONS": "{\n" + ",\n".join(map(_numbers, model["directions"])) + "}",
        "POWERS": "{\n" + ",\n".join(_numbers(row) for row in powers.tolist()) + "}",
        "COEFFICIENTS": "{\n" + ",\n".join(_numbers(row) for row in coefficients.tolist()) + "}",
    }
    code = _CODE
    for key, text in values.items():
        code = code.replace(f"@{key}@", text)
    return code


def _numbers(values: Sequence[float]) -> str:
    return "{" + ",".join(map(repr, values)) + "}"


def _listed(names: Iterable[str]) -> str:
    """Names for a comment, which none of them ends."""
    return ", ".join(names).replace("*/", "* /")
