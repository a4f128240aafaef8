/* The functions of Apple's Sparse/Solve.h that softcal calls, by their documented structures, with a dense LDL^T without
   pivoting. It writes down its calls, and refuses arguments that are not as documented. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct { unsigned transpose : 1, triangle : 1, kind : 2, reserved : 11, allocated : 1; } Attributes;
typedef struct { int rowCount, columnCount; long *columnStarts; int *rowIndices; Attributes attributes; uint8_t blockSize; } Structure;
typedef struct { Structure structure; double *data; } Matrix;
typedef struct { int rowCount, columnCount, columnStride; Attributes attributes; double *data; } Dense;
typedef struct {
  uint32_t control; uint8_t orderMethod; int *order, *ignored;
  void *(*malloc)(size_t); void (*free)(void *); void (*reportError)(const char *);
} SymbolicOptions;
typedef struct { uint32_t control; uint8_t scalingMethod; void *scaling; double pivotTolerance, zeroTolerance; } NumericOptions;
typedef struct {
  int status, rowCount, columnCount; Attributes attributes; uint8_t blockSize, type; void *factorization;
  size_t workspaceFloat, workspaceDouble, factorFloat, factorDouble;
} Symbolic;
typedef struct {
  int status; Attributes attributes; Symbolic symbolic; bool userStorage; void *numeric; size_t workStatic, workPerRHS;
} Factorization;

char calls[100000];
static SymbolicOptions options;

static void call(const char *name) { strcat(strcat(calls, name), " "); }

static bool documented(uint8_t type, const Matrix *a, const NumericOptions *o) {
  Structure s = a->structure;
  return type == 4 && s.rowCount == s.columnCount && s.blockSize == 1 && s.attributes.kind == 3 && s.attributes.triangle == 1
    && !s.attributes.transpose && !s.attributes.allocated && o->scalingMethod == 0 && o->pivotTolerance == 0.01
    && o->zeroTolerance > 0.0 && o->zeroTolerance < 1e-19 && s.columnStarts[0] == 0;
}

static void numeric(const Matrix *a, Factorization *f) {
  int n = a->structure.rowCount;
  double *l = f->numeric;
  memset(l, 0, sizeof(double) * n * n);
  for (int j = 0; j < n; j++)
    for (long k = a->structure.columnStarts[j]; k < a->structure.columnStarts[j + 1]; k++)
      l[a->structure.rowIndices[k] * n + j] = a->data[k];
  for (int j = 0; j < n; j++)
    for (int i = j + 1; i < n; i++) {
      double factor = l[j * n + j] == 0.0 ? 0.0 : l[i * n + j] / l[j * n + j];
      for (int k = j + 1; k <= i; k++) l[i * n + k] -= factor * l[k * n + j];
    }
}

Factorization _SparseFactorSymmetric_Double(uint8_t type, const Matrix *a, const SymbolicOptions *s, const NumericOptions *o) {
  Factorization f;
  memset(&f, 0, sizeof f);
  call("factor");
  options = *s;
  if (!documented(type, a, o) || s->orderMethod != 3 || s->order || s->ignored || !s->reportError) {
    f.status = -4;
    if (s->reportError) s->reportError("not as documented\n");
    return f;
  }
  size_t n = a->structure.rowCount;
  f.symbolic = (Symbolic){0, (int)n, (int)n, a->structure.attributes, 1, 4, s->malloc(16), 1, 160, n * n * 4, n * n * 8};
  f.numeric = s->malloc(n * n * sizeof(double));
  f.workStatic = 64;
  f.workPerRHS = n * sizeof(double);
  numeric(a, &f);
  return f;
}

void _SparseRefactorSymmetric_Double(const Matrix *a, Factorization *f, const NumericOptions *o, void *workspace) {
  call("refactor");
  memset(workspace, 0, f->symbolic.workspaceDouble);
  if (documented(4, a, o)) numeric(a, f); else options.reportError("not as documented\n");
}

void _SparseSolveOpaque_Double(const Factorization *f, const Dense *b, const Dense *x, void *workspace) {
  int n = f->symbolic.rowCount;
  const double *l = f->numeric;
  call("solve");
  memset(workspace, 0, f->workStatic + b->columnCount * f->workPerRHS);
  if (b->rowCount != n || b->columnStride < n || x->columnCount != b->columnCount) options.reportError("sizes\n");
  for (int c = 0; c < b->columnCount; c++) {
    double *y = x->data + (size_t)c * x->columnStride;
    memcpy(y, b->data + (size_t)c * b->columnStride, n * sizeof(double));
    for (int i = 0; i < n; i++) for (int j = 0; j < i; j++) y[i] -= l[i * n + j] / l[j * n + j] * y[j];
    for (int i = 0; i < n; i++) y[i] /= l[i * n + i];
    for (int i = n - 1; i >= 0; i--) for (int j = i + 1; j < n; j++) y[i] -= l[j * n + i] / l[i * n + i] * y[j];
  }
}

int _Z16SparseGetInertia32SparseOpaqueFactorization_DoublePiS0_S0_(Factorization f, int *positive, int *zero, int *negative) {
  int n = f.symbolic.rowCount;
  *positive = *zero = *negative = 0;
  for (int i = 0; i < n; i++) {
    double pivot = ((double *)f.numeric)[i * n + i];
    ++*(pivot > 0.0 ? positive : pivot < 0.0 ? negative : zero);
  }
  return f.symbolic.type == 4 ? 0 : -1;
}

void _SparseDestroyOpaqueNumeric_Double(Factorization *f) {
  call("destroy");
  options.free(f->numeric);
  options.free(f->symbolic.factorization);
}
