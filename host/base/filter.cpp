#include <broadcl/filter.hpp>

#include <map>
#include <string>
#include <utility>

#include <broadcl/error.hpp>

namespace broadcl {

std::vector<Filter> filters_from_layers(std::size_t layers,
                                        const std::function<bool(std::size_t, std::size_t)>& pairs) {
  constexpr std::size_t most = 32;
  std::vector<Filter> filters(layers);
  std::map<std::vector<bool>, std::size_t> groups;  // of the layers that pair with the same ones
  for (std::size_t a = 0; a < layers; ++a) {
    std::vector<bool> row(layers);
    for (std::size_t b = 0; b < layers; ++b) {
      row[b] = pairs(a, b);
      if (row[b] == pairs(b, a)) continue;
      throw Error::invalid_argument("layers " + std::to_string(a) + " and " + std::to_string(b) +
                                    " pair in one direction only; a filter needs both");
    }
    const std::size_t group =
        layers <= most ? a : groups.try_emplace(std::move(row), groups.size()).first->second;
    if (group == most) {
      throw Error::invalid_argument(
          "more than 32 kinds of objects differ in what they pair with, and a filter has 32 groups; leave "
          "out "
          "layers without objects, or give parts that never meet worlds of their own");
    }
    filters[a].group = 1U << group;
  }
  for (std::size_t a = 0; a < layers; ++a) {
    filters[a].mask = 0;
    for (std::size_t b = 0; b < layers; ++b) filters[a].mask |= pairs(a, b) ? filters[b].group : 0;
  }
  return filters;
}

std::vector<Filter> filters_from_one_sided(std::span<const std::uint32_t> types,
                                           std::span<const std::uint32_t> affinities) {
  if (types.size() != affinities.size()) {
    throw Error::invalid_argument("there are " + std::to_string(types.size()) + " types and " +
                                  std::to_string(affinities.size()) +
                                  " affinities; give one of each per object");
  }
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> layers;
  std::vector<std::size_t> layer_of;
  std::vector<std::size_t> first;  // object of each layer
  for (std::size_t k = 0; k < types.size(); ++k) {
    const auto [layer, is_new] = layers.try_emplace({types[k], affinities[k]}, layers.size());
    if (is_new) first.push_back(k);
    layer_of.push_back(layer->second);
  }
  const std::vector<Filter> of_layers = filters_from_layers(first.size(), [&](std::size_t a, std::size_t b) {
    return (types[first[a]] & affinities[first[b]]) != 0 || (types[first[b]] & affinities[first[a]]) != 0;
  });
  std::vector<Filter> filters;
  filters.reserve(layer_of.size());
  for (const std::size_t layer : layer_of) filters.push_back(of_layers[layer]);
  return filters;
}

}  // namespace broadcl
