#include <cstdint>

#include <gtest/gtest.h>

#include "bullet/proxy_pool.hpp"

namespace broadcl {
namespace {

/// When the numbers of calculations start again, proxies of the same number are no newer than others.
TEST(ProxyPool, ProxiesStayKnownWhenNumbersStartAgain) {
  constexpr std::uint32_t last_number = 5;
  ProxyPool pool(last_number);
  pool.reserve(2);
  for (const std::uint32_t id : {0U, 1U}) {
    pool[id].m_uniqueId = static_cast<int>(id);
    pool.mark_created(pool[id]);
    EXPECT_FALSE(pool.is_known({0, 1}));
    EXPECT_FALSE(pool.are_all_known());
    EXPECT_TRUE(pool.is_changed({0, 1}));
    for (std::uint32_t k = 0; k < 3 * last_number; ++k) {
      pool.end_calculation();
      if (id == 0) continue;
      EXPECT_TRUE(pool.is_known({0, 1})) << k;
      EXPECT_TRUE(pool.are_all_known()) << k;
      EXPECT_FALSE(pool.is_changed({0, 1})) << k;
      EXPECT_FALSE(pool.is_any_changed()) << k;
    }
  }
}

}  // namespace
}  // namespace broadcl
