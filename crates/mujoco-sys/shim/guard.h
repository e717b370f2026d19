/* Calls into MuJoCo that report mju_error as a value instead of ending the process. */

#include <mujoco/mujoco.h>
#include <stddef.h>

/* Installs the error and warning handlers; call once, before anything else of MuJoCo. */
void mjguard_install(void);

/* Each returns 0, or 1 when MuJoCo raised an error; mjguard_message() then tells which. */
int mjguard_loadXML(const char* filename, const mjVFS* vfs, char* error, int error_size, mjModel** out);
int mjguard_makeData(const mjModel* m, mjData** out);
int mjguard_resetData(const mjModel* m, mjData* d);
int mjguard_step(const mjModel* m, mjData* d, int n);
int mjguard_forward(const mjModel* m, mjData* d);
int mjguard_rnePostConstraint(const mjModel* m, mjData* d);
int mjguard_copyModel(const mjModel* m, mjModel** out);

/* Where bodies, geoms, sites, tendons, cameras and lights are at qpos. */
int mjguard_pose(const mjModel* m, mjData* d);

int mjguard_makeScene(const mjModel* m, mjvScene* scn, int maxgeom);
int mjguard_updateScene(const mjModel* m, mjData* d, const mjvOption* opt, mjvCamera* cam, mjvScene* scn);

/* A context whose offscreen buffer is the one that is drawn into. */
int mjguard_makeContext(const mjModel* m, mjrContext* con, int fontscale);

/* Draws the scene into the viewport. */
int mjguard_render(mjrRect viewport, mjvScene* scn, const mjrContext* con);
/* Writes two columns of text, one line a line, over a corner (mjtGridPos) of the viewport. */
int mjguard_overlay(int gridpos, mjrRect viewport, const char* left, const char* right, const mjrContext* con);
/* Reads the viewport, 3 bytes a pixel, bottom row first. */
int mjguard_readPixels(unsigned char* rgb, mjrRect viewport, const mjrContext* con);

/* Message of this thread's last error; valid until the next guarded call of the thread. */
const char* mjguard_message(void);

#define MJGUARD_LAYOUT 14
/* Sizes and offsets as the C compiler sees them, to compare with the generated bindings. */
extern const size_t mjguard_layout[MJGUARD_LAYOUT];
