/*
 * MuJoCo reports fatal conditions (stack overflow, broken arguments) through mju_error, whose
 * handler must not return: callers go on as if it never did. Unwinding a Rust panic through C
 * frames is undefined, so the handler jumps back to the guarded call instead. The jump crosses
 * frames of C functions only: stepping and drawing are plain C, and the C++ model compiler traps its
 * engine errors itself and throws them as its own exceptions.
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

int mjguard_copyModel(const mjModel* m, mjModel** out) {
  GUARDED(*out = mj_copyModel(NULL, m));
}

int mjguard_pose(const mjModel* m, mjData* d) {
  GUARDED(mj_kinematics(m, d); mj_comPos(m, d); mj_camlight(m, d); mj_tendon(m, d));
}

int mjguard_makeScene(const mjModel* m, mjvScene* scn, int maxgeom) {
  GUARDED(mjv_makeScene(m, scn, maxgeom));
}

int mjguard_updateScene(const mjModel* m, mjData* d, const mjvOption* opt, mjvCamera* cam, mjvScene* scn) {
  /* Endless planes are centred before the camera, which updateScene itself moves last. */
  GUARDED(mjv_updateCamera(m, d, cam, scn); mjv_updateScene(m, d, opt, NULL, cam, mjCAT_ALL, scn));
}

int mjguard_makeContext(const mjModel* m, mjrContext* con, int fontscale) {
  GUARDED(mjr_makeContext(m, con, fontscale); mjr_setBuffer(mjFB_OFFSCREEN, con));
}

int mjguard_render(mjrRect viewport, mjvScene* scn, const mjrContext* con) {
  GUARDED(mjr_render(viewport, scn, con));
}

int mjguard_overlay(int gridpos, mjrRect viewport, const char* left, const char* right, const mjrContext* con) {
  GUARDED(mjr_overlay(mjFONT_NORMAL, gridpos, viewport, left, right, con));
}

int mjguard_readPixels(unsigned char* rgb, mjrRect viewport, const mjrContext* con) {
  GUARDED(mjr_readPixels(rgb, NULL, viewport, con));
}

const size_t mjguard_layout[MJGUARD_LAYOUT] = {
    sizeof(mjModel),          sizeof(mjData),
    sizeof(mjVFS),            sizeof(mjContact),
    offsetof(mjModel, qpos0), offsetof(mjData, qpos),
    offsetof(mjData, xpos),   offsetof(mjData, warning),
    sizeof(mjvScene),         sizeof(mjvGeom),
    sizeof(mjvOption),        sizeof(mjvCamera),
    sizeof(mjrContext),       offsetof(mjrContext, offWidth),
};
