#include "shim/guard.h"
