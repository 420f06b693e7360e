/* What bindgen reads: OpenEXR's C core. */
#include <openexr.h>
