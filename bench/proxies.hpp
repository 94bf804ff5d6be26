#pragma once

namespace broadcl {

/// Benchmarks of proxies that come, move and go, through Bullet's interface. Each ends with
/// calculateOverlappingPairs(), and so with a correct pair cache:
///
///   proxies/create/NAME/SCENE/N        N proxies are created in an empty broad phase
///   proxies/create-more/NAME/SCENE/N   N proxies are created among N others
///   proxies/move/NAME/SCENE/N          all N proxies move by a tenth of their edge
///   proxies/teleport/NAME/SCENE/N      all N proxies move to positions unrelated to the old ones
///   proxies/destroy/NAME/SCENE/N       N of 2 N proxies are destroyed in random order
///   proxies/stream/NAME/SCENE/N        the same tenth of N proxies is destroyed and created again
///
/// NAME is one of scenes::broadphases(), with `+stock` if a BulletBroadphase is given a
/// btHashedOverlappingPairCache. bullet-sap is bt32BitAxisSweep3.
void register_proxies();

}  // namespace broadcl
