// Vectors in one, two and four registers compute like single numbers.
#include "ground/model/registers.h"

#include <gtest/gtest.h>

#include <array>

#include "ground/model/lanes.h"

namespace ground {
namespace {

using registers::Pair;
using registers::Register;

template <class V>
class RegistersTest : public testing::Test {
 protected:
  static constexpr int kCount = sizeof(V) / sizeof(double);
  using Numbers = std::array<double, kCount + 1>;

  /// Numbers that all differ, and a vector of all but the first, which is not aligned.
  static Numbers numbers(double first) {
    Numbers all;
    for (int i = 0; i <= kCount; ++i) all[static_cast<std::size_t>(i)] = first + 0.7 * i;
    return all;
  }
  static V vectorOf(const Numbers& all) { return registers::load<V>(all.data() + 1); }
};

using Vectors = testing::Types<Register, Pair<Register>, Pair<Pair<Register>>, Vec8>;
TYPED_TEST_SUITE(RegistersTest, Vectors);

TYPED_TEST(RegistersTest, ComputesNumberByNumber) {
  const auto a = this->numbers(-1), b = this->numbers(2);
  const TypeParam x = this->vectorOf(a), y = this->vectorOf(b);
  TypeParam z = x;
  z += y;
  z *= x;
  z -= x;
  z /= y;
  z *= 3.0;
  const TypeParam sum = x + y, difference = x - y, product = x * y, quotient = x / y, negative = -x,
                  left = 0.3 * x, right = x * 0.3, root = registers::sqrt(y);
  for (int i = 0; i < this->kCount; ++i) {
    const double p = a[static_cast<std::size_t>(i) + 1], q = b[static_cast<std::size_t>(i) + 1];
    EXPECT_EQ(registers::at(sum, i), p + q);
    EXPECT_EQ(registers::at(difference, i), p - q);
    EXPECT_EQ(registers::at(product, i), p * q);
    EXPECT_EQ(registers::at(quotient, i), p / q);
    EXPECT_EQ(registers::at(negative, i), -p);
    EXPECT_EQ(registers::at(left, i), 0.3 * p);
    EXPECT_EQ(registers::at(right, i), p * 0.3);
    EXPECT_EQ(registers::at(root, i), std::sqrt(q));
    EXPECT_NEAR(registers::at(z, i), ((p + q) * p - p) / q * 3.0, 1e-13);
  }
}

TYPED_TEST(RegistersTest, ComparesAndBlendsEachNumber) {
  for (int i = 0; i < this->kCount; ++i) {
    auto a = this->numbers(0);
    const TypeParam y = this->vectorOf(a);
    a[static_cast<std::size_t>(i) + 1] -= 1;
    const TypeParam x = this->vectorOf(a);
    const auto less = x < y, greater = y > x, equal = x == y;
    EXPECT_FALSE(registers::allOf(less));
    EXPECT_FALSE(registers::noneOf(less));
    EXPECT_FALSE(registers::allOf(equal));
    EXPECT_EQ(registers::allOf(equal | less), true);
    EXPECT_EQ(registers::noneOf(equal & less), true);
    const TypeParam blended = registers::blend(less, TypeParam(-y), y);
    for (int j = 0; j < this->kCount; ++j) {
      EXPECT_EQ(registers::at(less, j) != 0, i == j);
      EXPECT_EQ(registers::at(greater, j) != 0, i == j);
      EXPECT_EQ(registers::at(equal, j) != 0, i != j);
      EXPECT_EQ(registers::at(blended, j), (i == j ? -1 : 1) * registers::at(y, j));
    }
  }
}

TYPED_TEST(RegistersTest, FillsWithANumberOfEitherSign) {
  for (const double a : {2.5, -0.0, 0.0}) {
    const TypeParam x = registers::filled<TypeParam>(a);
    for (int i = 0; i < this->kCount; ++i) {
      EXPECT_EQ(registers::at(x, i), a);
      EXPECT_EQ(std::signbit(registers::at(x, i)), std::signbit(a));
    }
  }
}

TYPED_TEST(RegistersTest, StoresWhereItLoaded) {
  const auto a = this->numbers(4);
  auto b = this->numbers(-9);
  registers::store(this->vectorOf(a), b.data() + 1);
  EXPECT_EQ(b[0], -9);
  for (std::size_t i = 1; i < b.size(); ++i) EXPECT_EQ(b[i], a[i]);
}

// Libraries for different processors exchange them in memory.
TEST(RegistersTest, EightNumbersHaveOneLayout) {
  static_assert(sizeof(Vec8) == 64 && alignof(Vec8) == 64, "");
  Lanes x = 0.0;
  for (int i = 0; i < Lanes::kCount; ++i) x[i] = i;
  for (int i = 0; i < Lanes::kCount; ++i) {
    EXPECT_EQ(registers::at(x.x, i), i);
    EXPECT_EQ(reinterpret_cast<const double*>(&x)[i], i);
  }
}

}  // namespace
}  // namespace ground

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
