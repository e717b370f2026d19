/*
 * MuJoCo reports fatal conditions (stack overflow, broken arguments) through mju_error, whose
 * handler must not return: callers go on as if it never did. Unwinding a Rust panic through C
 * frames is undefined, so the handler jumps back to the guarded call instead. The jump crosses
 * frames of C functions only: stepping is plain C, and the C++ model compiler traps its engine
 * errors itself and throws them as its own exceptions.
 */

#include "guard.h"

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static _Thread_local jmp_buf* landing = NULL;
static _Thread_local char message[1024];

static void on_error(const char* text) {
  snprintf(message, sizeof message, "%s", text);
  if (landing) {
    longjmp(*landing, 1);
  }
  /* Raised outside a guarded call: the state is unknown and returning is not allowed. */
  fprintf(stderr, "MuJoCo error outside a guarded call: %s\n", text);
  abort();
}

/* Warnings are counted in mjData, where they are read as values; nothing is printed or logged. */
static void on_warning(const char* text) {
  (void)text;
}

void mjguard_install(void) {
  mju_user_error = on_error;
  mju_user_warning = on_warning;
}

const char* mjguard_message(void) {
  return message;
}

#define GUARDED(call)           \
  do {                          \
    jmp_buf here;               \
    jmp_buf* before = landing;  \
    if (setjmp(here) != 0) {    \
      landing = before;         \
      return 1;                 \
    }                           \
    landing = &here;            \
    call;                       \
    landing = before;           \
    return 0;                   \
  } while (0)

int mjguard_loadXML(const char* filename, const mjVFS* vfs, char* error, int error_size, mjModel** out) {
  GUARDED(*out = mj_loadXML(filename, vfs, error, error_size));
}

int mjguard_makeData(const mjModel* m, mjData** out) {
  GUARDED(*out = mj_makeData(m));
}

int mjguard_resetData(const mjModel* m, mjData* d) {
  GUARDED(mj_resetData(m, d));
}

int mjguard_step(const mjModel* m, mjData* d, int n) {
  GUARDED(for (int i = 0; i < n; i++) mj_step(m, d));
}

int mjguard_forward(const mjModel* m, mjData* d) {
  GUARDED(mj_forward(m, d));
}

int mjguard_rnePostConstraint(const mjModel* m, mjData* d) {
  GUARDED(mj_rnePostConstraint(m, d));
}

const size_t mjguard_layout[8] = {
    sizeof(mjModel),          sizeof(mjData),
    sizeof(mjVFS),            sizeof(mjContact),
    offsetof(mjModel, qpos0), offsetof(mjData, qpos),
    offsetof(mjData, xpos),   offsetof(mjData, warning),
};
