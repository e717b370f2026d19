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

/* Message of this thread's last error; valid until the next guarded call of the thread. */
const char* mjguard_message(void);

/* Sizes and offsets as the C compiler sees them, to compare with the generated bindings. */
extern const size_t mjguard_layout[8];
