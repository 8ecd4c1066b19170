/* What bindgen reads: the newest Embree that is installed. build.rs tells which by RTC_VERSION_MAJOR. */
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#elif __has_include(<embree3/rtcore.h>)
#include <embree3/rtcore.h>
#else
#error "neither embree4/rtcore.h nor embree3/rtcore.h was found"
#endif
