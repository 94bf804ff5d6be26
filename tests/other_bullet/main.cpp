// Succeeds if BroadCL notices that this program was compiled with another Bullet.
#include <broadcl/bullet.hpp>
#include <cstdio>
#include <cstring>

int main() {
  try {
    broadcl::BulletBroadphase broadphase;
  } catch (const broadcl::Error& error) {
    std::printf("%s\n", error.what());
    return std::strstr(error.what(), "this program was compiled with Bullet 3.99") != nullptr ? 0 : 1;
  }
  std::printf("a broad phase was made\n");
  return 1;
}
