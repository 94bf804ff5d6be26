#pragma once

namespace broadcl {

/// Benchmarks of proxies that come, move and go, through Bullet's interface. Each ends with
/// calculateOverlappingPairs(), so with the pair cache right:
///
///   proxies/create/NAME/SCENE/N        N are created where there is none
///   proxies/create-more/NAME/SCENE/N   N are created among N others
///   proxies/move/NAME/SCENE/N          all of N move by a tenth of their edge
///   proxies/teleport/NAME/SCENE/N      all of N go to places that have nothing to do with the old ones
///   proxies/destroy/NAME/SCENE/N       of 2 N, N are destroyed in random order
///   proxies/stream/NAME/SCENE/N        of N, the same tenth is destroyed and created again
///
/// NAME is one of scenes::broadphases(), with `+stock` where a BulletBroadphase is given a
/// btHashedOverlappingPairCache. bullet-sap is bt32BitAxisSweep3.
void register_proxies();

}  // namespace broadcl
