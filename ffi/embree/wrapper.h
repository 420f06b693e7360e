/* What bindgen reads: Embree's public API, of the major version that build.rs found. */
#if LUMI_EMBREE4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
