"""conda.py RECIPE: renders a recipe of conda, and prints as a shell script what conda runs: it builds, installs into $PREFIX, looks
for the files that the package must have, and runs its test."""
import sys

from rattler_build import Stage0Recipe, VariantConfig

variants = VariantConfig({"c_stdlib": ["sysroot"]})  # as conda-forge has it for Linux
(rendered,) = Stage0Recipe.from_file(sys.argv[1]).render(variants)
recipe = rendered.recipe.to_dict()
package, test = recipe["tests"]
contents = package["package_contents"]
print(*recipe["build"]["script"], 'cd "$PREFIX"', sep="\n")
print("ls", *[f"bin/{name}" for name in contents["bin"]], *[f"include/{name}" for name in contents["include"]],
      *[f"lib/lib{name}.so" for name in contents["lib"]])
print('PATH="$PREFIX/bin:$PATH"', test["script"])
