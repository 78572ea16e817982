// Effects with a wrong hook, one each, that must not compile (test/python/test_downstream.py).
#include "ground/model/effect_registry.h"

namespace {

using namespace ground;

struct Named {
  static EffectInfo info() { return {"wrong", "", {}}; }
};

#ifdef RIGHT
struct Right : Named {
  template <typename T>
  static void air(const T*, Vector2<T>&) {}
};
GROUND_REGISTER_EFFECT(Right)
#else
struct WrenchByValue : Named {
  template <typename T>
  static void wrench(const T*, const Point<T>&, Vector3<T>) {}
};
GROUND_REGISTER_EFFECT(WrenchByValue)

struct MissingPoint : Named {
  template <typename T>
  static void thrust(const T*, Vector2<T>&) {}
};
GROUND_REGISTER_EFFECT(MissingPoint)

struct IsNotATemplate : Named {
  static void air(const double*, Vector2<double>&) {}
};
GROUND_REGISTER_EFFECT(IsNotATemplate)

struct IsNotStatic : Named {
  template <typename T>
  void inertia(const T*, const Body<T>&, Matrix3<T>&) {}
};
GROUND_REGISTER_EFFECT(IsNotStatic)

struct ChangesItsInput : Named {
  template <typename T>
  static void measure(const T*, Vector3<T>&, Measurement<T>&) {}
};
GROUND_REGISTER_EFFECT(ChangesItsInput)

struct ReturnsAValue : Named {
  template <typename T>
  static T delay(const T* p, T&) {
    return p[0];
  }
};
GROUND_REGISTER_EFFECT(ReturnsAValue)

struct IsMisspelled : Named {
  template <typename T>
  static void wrnech(const T*, const Point<T>&, Vector3<T>&) {}
};
GROUND_REGISTER_EFFECT(IsMisspelled)
#endif

}  // namespace
