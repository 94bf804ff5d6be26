#include <LinearMath/btScalar.h>

// The rest of this file is a program that was compiled with another Bullet.
#undef BT_BULLET_VERSION
#define BT_BULLET_VERSION 399
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <broadcl/bullet.hpp>
#include <utility>

#include "expect_error.hpp"

namespace broadcl {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Abi = detail::BulletAbi;

TEST(OtherBullet, IsRefused) {
  EXPECT_THAT(test::error_of([] { const BulletBroadphase broadphase; }),
              AllOf(HasSubstr("this program was compiled with Bullet 3.99 (btVector3 of "),
                    HasSubstr("build BroadCL with the program's Bullet")));
}

TEST(OtherBullet, IsRefusedWhateverDiffers) {
  Abi same = detail::bullet_abi;
  same.version = btGetVersion();
  EXPECT_NO_THROW(BulletBroadphase(Config(), nullptr, same));
  const auto error_with = [&](auto member, auto value) {
    Abi other = same;
    other.*member = value;
    return test::error_of([&] { const BulletBroadphase broadphase(Config(), nullptr, other); });
  };
  EXPECT_THAT(error_with(&Abi::version, 305), HasSubstr("with Bullet 3.05 ("));
  EXPECT_THAT(error_with(&Abi::vector_size, 99U), HasSubstr("btVector3 of 99 bytes"));
  EXPECT_THAT(error_with(&Abi::proxy_size, 99U), HasSubstr("btBroadphaseProxy of 99 bytes"));
  EXPECT_THAT(error_with(&Abi::object_size, 99U), HasSubstr("btCollisionObject of 99 bytes"));
  EXPECT_THAT(error_with(&Abi::vector_alignment, 99U), HasSubstr("aligned to 99, btBroadphaseProxy"));
  EXPECT_THAT(error_with(&Abi::proxy_alignment, 99U), HasSubstr("aligned to 99, btCollisionObject"));
  EXPECT_THAT(error_with(&Abi::object_alignment, 99U), HasSubstr("aligned to 99), but BroadCL with"));
}

}  // namespace
}  // namespace broadcl
