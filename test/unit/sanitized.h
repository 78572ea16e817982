// Whether tests run under a sanitizer, which takes thirty to eighty times as long: it looks at each path
// once, so that what is repeated for statistics need not be repeated.
#pragma once

namespace ground {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

}  // namespace ground
