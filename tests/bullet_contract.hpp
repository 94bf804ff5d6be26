#pragma once

// The statements of the contract between a btBroadphaseInterface and Bullet 3.24. Each has a test with its
// number, for BroadCL's broad phase and, to prove the tests themselves, for Bullet's own: 1 to 6 in
// bullet_proxies_test.cpp, 7 to 18 in bullet_pairs_test.cpp, 20 to 24 in bullet_caches_test.cpp, 25 to 28 in
// bullet_queries_test.cpp, 29 to 33 in bullet_life_test.cpp. 19 (pairs of double builds are exact)
// is in bullet_float64_test.cpp.
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCache.h>
#include <BulletCollision/BroadphaseCollision/btOverlappingPairCallback.h>

#include <optional>
#include <set>
#include <string>
#include <string_view>

#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

#include "bullet_rig.hpp"
#include "mortal_algorithm.hpp"

namespace broadcl::test {

/// If one of Bullet's own broad phases breaks a statement, the test says so and why, and must fail for it.
class Contract : public testing::TestWithParam<Kind> {
 protected:
  void fails(std::string_view kind, std::string_view why) {
    if (GetParam().name != kind) return;
    RecordProperty("breaks_it", std::string(why));
    reporter_.emplace(testing::ScopedFakeTestPartResultReporter::INTERCEPT_ONLY_CURRENT_THREAD,
                      &intercepted_);
  }
  /// For a test that would never return, or would not always fail: it is not run.
  bool unfit(std::string_view kind, std::string_view why) {
    if (GetParam().name != kind) return false;
    RecordProperty("not_run", std::string(why));
    return true;
  }
  void TearDown() override {
    if (!reporter_) return;
    reporter_.reset();
    bool failed = false;
    for (int k = 0; k < intercepted_.size(); ++k) failed |= intercepted_.GetTestPartResult(k).failed();
    EXPECT_TRUE(failed) << GetParam().name << " keeps this statement: remove the exception";
  }

 private:
  testing::TestPartResultArray intercepted_;
  std::optional<testing::ScopedFakeTestPartResultReporter> reporter_;
};

/// Records what is reported to ghosts.
class GhostRecorder final : public btOverlappingPairCallback {
 public:
  btBroadphasePair* addOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t) override {
    ++added;
    clients.insert({s->m_clientObject, t->m_clientObject});
    return nullptr;
  }
  void* removeOverlappingPair(btBroadphaseProxy* s, btBroadphaseProxy* t, btDispatcher* /*d*/) override {
    ++removed;
    clients.insert({s->m_clientObject, t->m_clientObject});
    return nullptr;
  }
  void removeOverlappingPairsContainingProxy(btBroadphaseProxy* /*s*/, btDispatcher* /*d*/) override {
    ++forbidden;
  }
  int added = 0;
  int removed = 0;
  int forbidden = 0;
  std::set<const void*> clients;
};

/// Reports its destruction.
class MortalCache final : public btHashedOverlappingPairCache {
 public:
  explicit MortalCache(bool& dead) : dead_(dead) {}
  ~MortalCache() override { dead_ = true; }
  MortalCache(const MortalCache&) = delete;
  MortalCache& operator=(const MortalCache&) = delete;
  MortalCache(MortalCache&&) = delete;
  MortalCache& operator=(MortalCache&&) = delete;

 private:
  bool& dead_;
};

}  // namespace broadcl::test
