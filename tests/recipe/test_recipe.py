import dataclasses
import tomllib
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest

from synthnet import recipe
from synthnet.errors import RecipeError
from synthnet.recipe import AugmentationSettings, Recipe, Subset, distributions, parsing
from synthnet.recipe.plan import plan_shards
from synthnet.store import pins

TEXT = """
schema = 1
version = "test"
seed = 7
shard_size = 3
label = { eigenvalues = 4 }
filters = { altitude = 1e-6, trivial = 1e-6, residual = 1e-6 }
augmentation = { rotations = 2, reflections = 2 }
splits = { train = 0.7, validation = 0.2, test = 0.1 }
[families.sphere]
count = 5
parameters.radius = 1.0
parameters.resolution = { integers = [4, 9] }
"""
SUBSET = 'schema = 1\nversion = "part"\nsubset = { of = "1.0", share = 0.02, least = 5 }\n'
LAST_BELOW_ONE = 1 - 2**-53  # the largest value of Generator.random


def random_of(*values):
    """A generator that draws these numbers."""
    return SimpleNamespace(random=iter(values).__next__)


def draw_one(distribution, u):
    return distributions.draw({"x": distribution}, random_of(u))["x"]


def edited(old, new, text=TEXT):
    assert text.count(old) == 1
    return text.replace(old, new)


def leaves(tree, path=()):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key)


def changed(value):
    if isinstance(value, list):
        return [value[0] - 1, *value[1:]]
    return value + "x" if isinstance(value, str) else value + 1


def test_the_test_recipe_is_good():
    parsed = recipe.parse(TEXT)
    assert (parsed.version, parsed.base, parsed.seed, parsed.count) == ("test", "test", 7, 5)
    assert parsed.subset is None


def refused(text, message):
    with pytest.raises(RecipeError, match=message):
        recipe.parse(text)


@pytest.mark.parametrize("text", ["schema = ", "a = 1\na = 2", "[families"])
def test_text_that_is_no_toml_is_refused(text):
    refused(text, r"recipe is not valid TOML: \w+")


@pytest.mark.parametrize("schema", ["", "schema = 2", 'schema = "1"'])
def test_another_schema_is_refused(schema):
    refused(edited("schema = 1", schema), "recipe schema must be 1: use a matching")


@pytest.mark.parametrize("table", ["label", "filters", "augmentation", "splits", "families"])
def test_a_missing_table_is_named(table):
    lines = [s for s in TEXT.split("[families")[0].splitlines() if not s.startswith(table)]
    families = "" if table == "families" else "[families" + TEXT.split("[families")[1]
    text = "\n".join(lines) + "\n" + families
    refused(text, f"^recipe has a missing key: {table}$")


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("seed = 7", "seed = 7\nsalt = 1", "salt"),
        ("seed = 7", "", "seed"),
        ('version = "test"', "", "version"),
        ("eigenvalues = 4", "", "eigenvalues"),
        ("eigenvalues = 4", "eigenvalues = 4, shift = -1.0", "shift"),
        ("trivial = 1e-6", "trivial = 1e-6, area = 1", "area"),
        ("rotations", "turns", "turns"),
        ("test = 0.1", "holdout = 0.1", "holdout"),
        ("count = 5", "", "count"),
        ("count = 5", "count = 5\nweight = 2", "weight"),
    ],
)
def test_a_missing_or_unknown_key_is_named(old, new, named):
    refused(edited(old, new), rf"has an? (missing|unknown) key: .*{named}")


@pytest.mark.parametrize(
    "value",
    [
        '"1"',
        "true",
        "nan",
        "[4, 9]",
        "{}",
        "{ normal = [0, 1] }",
        "{ integers = [4, 9], uniform = [0, 1] }",
        "{ integers = 4 }",
        "{ integers = [4] }",
        "{ integers = [9, 4] }",
        "{ integers = [4, 9.5] }",
        "{ uniform = [1, 0] }",
        "{ uniform = [0, inf] }",
        "{ log10_normal = [0, -1] }",
    ],
)
def test_a_bad_distribution_is_refused(value):
    message = "parameter resolution must be a number or one of log10_normal, uniform, integers"
    refused(edited("{ integers = [4, 9] }", value), f"family sphere: {message}")


@pytest.mark.parametrize(
    "value",
    [
        "{ log10_normal = [400.5, 1.0] }",
        "{ log10_normal = [300, 3] }",
        "{ uniform = [-1e308, 1e308] }",
        f"{{ integers = [0, 1{'0' * 400}] }}",
    ],
)
def test_a_distribution_of_numbers_that_no_float_is_is_refused(value):
    message = "^family sphere: parameter resolution must (have finite draws|be a number or one)"
    refused(edited("{ integers = [4, 9] }", value), message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("test = 0.1", "test = 0.2", r"^splits must be positive and add up to 1, .*'test': 0\.2"),
        ("test = 0.1", "test = 0.1001", r"positive and add up to 1, got .*'test': 0\.1001"),
        ("test = 0.1", "test = -0.1", r"positive and add up to 1, got .*'test': -0\.1"),
        # The sum is one.
        ("0.7, validation = 0.2", "1.1, validation = -0.2", r"positive .*'validation': -0\.2"),
        ("count = 5", "count = 0", "^family sphere: count must be at least 1, got 0$"),
        ("count = 5", "count = -1", "^family sphere: count must be at least 1, got -1$"),
        ("seed = 7", "seed = -7", "^seed must be at least 0, got -7$"),
        ("seed = 7", "seed = 7.5", "^recipe: seed must be an integer, got 7.5$"),
        ("seed = 7", "seed = true", "^recipe: seed must be an integer, got True$"),
        ('version = "test"', "version = 1", "^recipe: version must be a string, got 1$"),
        ("count = 5", "count = 2.5", "^family sphere: count must be an integer, got 2.5$"),
        ("test = 0.1", 'test = "a"', "^splits: test must be a number, got 'a'$"),
        ("test = 0.1", "test = nan", "^splits: test must be a number, got nan$"),
        ("eigenvalues = 4", "eigenvalues = 0", "^label: eigenvalues must be at least 1, got 0$"),
        ("rotations = 2", "rotations = -1", "^augmentation: rotations must be at least 0, got -1$"),
    ],
)
def test_a_value_that_will_not_do_is_named(old, new, message):
    refused(edited(old, new), message)


@pytest.mark.parametrize("name", ["../up", "/abs", "", ".", ".lock", "a\\nb", "a" * 101])
def test_a_version_that_is_no_name_of_a_directory_is_refused(name):
    message = "^version must be at most 100 letters, digits, .* the first a letter or a digit, got"
    refused(edited('version = "test"', f'version = "{name}"'), message)
    refused(edited('version = "part"', f'version = "{name}"', SUBSET), message)


@pytest.mark.parametrize("name", ["mine-x5", "mine-sealed-0123456789ab"])
def test_a_version_that_has_the_name_of_another_kind_is_refused(name):
    message = rf"^version must not end as scaled versions \(-x5\) and sealed sets do, got '{name}'$"
    refused(edited('version = "test"', f'version = "{name}"'), message)
    refused(edited('version = "part"', f'version = "{name}"', SUBSET), message)


def test_families_must_be_tables():
    text = TEXT.split("[families")[0].replace("schema = 1", "schema = 1\nfamilies = []")
    refused(text, r"^families must be tables, got \[\]$")


def test_parameters_must_be_a_table():
    family = "[families.sphere]\ncount = 5\nparameters = 3\n"
    text = TEXT.split("[families")[0] + family
    refused(text, "^family sphere: parameters must be a table, got 3$")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("share = 0.02", "share = -1", "^subset: share must be above 0, at most 1, got -1$"),
        ("share = 0.02", "share = 2", "^subset: share must be above 0, at most 1, got 2$"),
        ("least = 5", "least = 0", "^subset: least must be at least 1, got 0$"),
        (", least = 5", "", "has a missing key: least$"),
        ("share = 0.02", "share = 0.02, first = 3", "has an unknown key: first$"),
        ('version = "part"', "", "has a missing key: version$"),
        ("schema = 1", "schema = 1\nseed = 3", "seed"),
        ('"1.0"', '"0.9"', r"unknown version '0\.9'"),
        ('"1.0"', '"1.0-mini"', r"^1\.0-mini is a subset: take a share of 1\.0$"),
        ('"1.0"', '"1.0-x2"', r"^1\.0-x2 is scaled: take a share of what it came from$"),
    ],
)
def test_a_subset_that_will_not_do_is_refused(old, new, message):
    refused(edited(old, new, SUBSET), message)


@pytest.mark.parametrize(
    ("version", "message"),
    [
        ("0.9", "unknown version '0.9': choose one of 1.0, 1.0-mini, 1.0-small, 2.0"),
        *(
            (f"1.0-x{n}", "scale must be an integer from 2 to 100,000, got")
            for n in (0, 1, 100_001)
        ),
        ("1.0-x2-x2", r"1\.0-x2 is scaled already"),
    ],
)
def test_a_version_that_there_is_not_is_refused(version, message):
    with pytest.raises(RecipeError, match=message):
        recipe.load(version)


@pytest.mark.parametrize("version", recipe.available())
def test_every_version_that_ships_carries_its_own_name(version):
    loaded = recipe.load(version)
    assert (loaded.version, loaded.base) == (version, version.partition("-")[0])
    assert loaded == recipe.load(version)


def test_a_subset_inherits_everything_but_its_name():
    base, mini = recipe.load("1.0"), recipe.load("1.0-mini")
    assert dataclasses.replace(mini, version="1.0", subset=None) == base


TORUS = "[families.torus]\ncount = 3\nparameters.tube_radius = 0.3\n"
EXTENSION = f'schema = 1\nversion = "more"\nextends = "2.0"\n{TORUS}'


def test_an_extension_adds_families_and_keeps_the_rest():
    base = recipe.load("2.0")
    more = recipe.parse(EXTENSION)
    assert list(more.families) == [*base.families, "torus"]
    kept = {"version": "2.0", "families": base.families, "protocols": base.protocols}
    assert dataclasses.replace(more, **kept) == base
    assert more.protocols["family"][-1].families == ("torus",)
    assert more.families["torus"].count == 3


def test_an_extension_may_have_protocols_of_its_own():
    more = recipe.parse(EXTENSION + '[protocols.round]\nheld_out.families = ["torus", "drum"]\n')
    assert list(more.protocols or {}) == ["round"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"2.0"', '"3.0"', "^extends must be one of 1.0, .*, got '3.0'$"),
        ('version = "more"', "", "^recipe has a missing key: version$"),
        ('"2.0"', "2", "^extends must be one of 1.0, .*, got 2$"),
        ('"2.0"', '"2.0-mini"', "^2.0-mini is a subset: extend the version that it is of$"),
        ("torus", "drum", "^2.0 has families of this name already: drum$"),
        (TORUS, "families = 3", "^families must be tables, got 3$"),
    ],
)
def test_an_extension_that_will_not_do_is_refused(old, new, message):
    refused(edited(old, new, EXTENSION), message)


def test_2_1_has_all_of_2_0_with_the_same_splits():
    planned = {
        version: {
            shape.spec.id: (shape.spec, shape.split)
            for plan in plan_shards(recipe.load(version))
            for shape in plan.shapes
        }
        for version in ("2.0", "2.1")
    }
    assert [len(shapes) for shapes in planned.values()] == [9930, 14430]
    assert planned["2.0"].items() <= planned["2.1"].items()


def test_the_digest_changes_with_every_value():
    text = resources.files("synthnet.recipe.versions").joinpath("1.0.toml").read_text()
    original = recipe.parse(text)

    def build(raw):
        families = {n: recipe.FamilyRecipe(**f) for n, f in raw["families"].items()}
        return Recipe(
            raw["version"],
            raw["seed"],
            raw["shard_size"],
            recipe.LabelSettings(**raw["label"]),
            recipe.FilterSettings(**raw["filters"]),
            AugmentationSettings(**raw["augmentation"]),
            recipe.SplitSettings(**raw["splits"]),
            families,
        )

    assert build(tomllib.loads(text)).digest == original.digest
    paths = [path for path in leaves(tomllib.loads(text)) if path != ("schema",)]
    assert len(paths) == 3 + 1 + 3 + 2 + 3 + 10 + 44
    digests = {original.digest, recipe.load("1.0-mini").digest, recipe.load("1.0-small").digest}
    for path in paths:
        raw = tomllib.loads(text)
        table = raw
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = changed(table[path[-1]])
        digests.add(build(raw).digest)
    assert len(digests) == len(paths) + 3


@dataclasses.dataclass(frozen=True, slots=True)
class Younger(recipe.FilterSettings):
    """The settings of a later release, with one filter more."""

    valence: "float | None" = None


def test_a_filter_that_a_recipe_does_not_name_leaves_its_digest(monkeypatch):
    older = recipe.parse(TEXT).digest
    monkeypatch.setattr(parsing, "FilterSettings", Younger)
    assert recipe.parse(TEXT).filters.valence is None
    assert recipe.parse(TEXT).digest == older
    named = TEXT.replace("filters = {", "filters = { valence = 7,")
    assert recipe.parse(named).filters.valence == 7
    assert recipe.parse(named).digest != older
    with pytest.raises(RecipeError, match="filters: valence must be a number, got '7'"):
        recipe.parse(named.replace("valence = 7", "valence = '7'"))


def test_the_digest_does_not_hang_on_the_order_of_keys():
    swapped = edited("train = 0.7, validation = 0.2", "validation = 0.2, train = 0.7")
    assert recipe.parse(swapped).digest == recipe.parse(TEXT).digest


@pytest.mark.parametrize(
    ("share", "count", "size"),
    [
        (0.02, 2000, 40),
        (0.02, 50, 5),  # 1, but at least five
        (0.02, 3, 3),  # never more than there are
        (0.1, 50, 5),
        (0.1, 1004, 100),  # 100.4
        (0.1, 1006, 101),  # 100.6
        (1.0, 7, 7),
    ],
)
def test_size_of_a_subset(share, count, size):
    assert Subset("1.0", share, least=5).size(count) == size


@pytest.mark.parametrize(
    ("u", "value"),
    [
        (0.0, 0.01),  # 10^(-3 · 2/3)
        (1e-9, 0.01),
        (0.001349, 0.01),  # Phi(-3) = 0.00134990
        (0.00135, 0.0100004),
        (0.5, 1.0),
        (0.99865, 99.996),
        (0.998651, 100.0),
        (LAST_BELOW_ONE, 100.0),
    ],
)
def test_log_normal_is_clamped_at_three_standard_deviations(u, value):
    assert draw_one({"log10_normal": [0.0, 2 / 3]}, u) == pytest.approx(value, rel=1e-5)


def test_log_normal_at_one_standard_deviation():
    # Phi(1) = 0.841344746; 10^(1/2 + 1/6) = 4.64158883
    assert draw_one({"log10_normal": [0.5, 1 / 6]}, 0.8413447460685429) == 4.64158883


def test_tube_radius_ends_exactly_at_the_limit_of_embeddedness():
    tube = recipe.load("1.0").families["torus"].parameters["tube_radius"]
    assert draw_one(tube, 0.0) == 0.1
    assert draw_one(tube, LAST_BELOW_ONE) == 1.0


@pytest.mark.parametrize(("low", "high"), [(3, 5), (20, 100), (1, 20), (7, 7), (-2, 1)])
def test_integers_take_both_ends_and_all_between_equally_often(low, high):
    count = high - low + 1
    grid = [(i + 0.5) / (16 * count) for i in range(16 * count)]
    values = [draw_one({"integers": [low, high]}, u) for u in grid]
    assert values == [v for v in range(low, high + 1) for _ in range(16)]
    assert all(type(v) is int for v in values)


def test_integers_at_the_ends_of_the_unit_interval():
    for count in range(1, 300):
        assert draw_one({"integers": [1, count]}, 0.0) == 1
        assert draw_one({"integers": [1, count]}, LAST_BELOW_ONE) == count


def test_uniform_is_linear_and_takes_both_ends():
    flip = {"uniform": [0.5, 1.0]}
    assert [draw_one(flip, u) for u in (0.0, 0.25, LAST_BELOW_ONE)] == [0.5, 0.625, 1.0]


def test_values_have_nine_significant_digits():
    assert draw_one({"uniform": [0.0, 1.0]}, 1 / 3) == 0.333333333
    assert draw_one({"uniform": [0.0, 1000.0]}, 2 / 3) == 666.666667
    assert draw_one({"log10_normal": [1 / 2, 0.0]}, 0.7) == 3.16227766  # sqrt(10)
    rng = np.random.default_rng(0)
    for distribution in ({"log10_normal": [0.0, 2 / 3]}, {"uniform": [0.5, 1.0]}):
        for value in (draw_one(distribution, rng.random()) for _ in range(100)):
            assert value == float(f"{value:.9g}")


def test_a_constant_uses_up_a_number_and_is_kept_as_it_is():
    uniform = {"uniform": [0.0, 1.0]}
    drawn = distributions.draw({"a": uniform, "b": 3, "c": uniform}, random_of(0.25, 0.5, 0.75))
    assert drawn == {"a": 0.25, "b": 3, "c": 0.75}
    assert type(drawn["b"]) is int


def test_generator_is_a_function_of_its_arguments():
    def numbers(*key):
        return tuple(distributions.generator(*key).random(3))

    keys = [
        (seed, family, index, stream)
        for seed in (0, 1)
        for family in ("cone", "torus")
        for index in (0, 1)
        for stream in (distributions.PARAMETERS, distributions.ISOMETRIES)
    ]
    first = {key: numbers(*key) for key in keys}
    np.random.default_rng(3).random()
    assert {key: numbers(*key) for key in reversed(keys)} == first
    assert len(set(first.values())) == len(keys)


def test_generator_draws_what_it_always_drew():
    assert distributions.generator(20240726, "torus", 42, 0).random() == 0.5330528482406418


def test_digests_of_the_versions_that_ship_never_change():
    frozen = [v for v in recipe.available() if pins.read(recipe.load(v).base) is not None]
    assert {v: recipe.load(v).digest[:16] for v in frozen} == {
        "1.0": "c8bd58d9b709a29e",
        "1.0-mini": "99a57a6aa230d17e",
        "1.0-small": "ff94adc77e7700ee",
        "2.0": "63841548a5460f34",
        "2.0-mini": "688f4216aa0a8d63",
        "2.1": "543880f3ca869e72",
        "2.1-mini": "0e3fe65d18b06fc9",
    }
    assert recipe.load("1.0-x2").digest != recipe.load("1.0").digest


SIZED = TEXT.replace("[families", '[[sizes]]\nname = "a"\nvertices = 500\n\n[families', 1)


def test_sizes_are_meshes_of_one_surface():
    text = SIZED.replace("[families", '[[sizes]]\nname = "b"\nvertices = 900\n\n[families', 1)
    loaded = recipe.parse(text.replace("count = 5", "count = 6"))
    assert (loaded.copies, loaded.count) == (2, 6)
    assert loaded.sizes == (recipe.Size("a", 500), recipe.Size("b", 900))
    turned = dataclasses.replace(loaded, sizes=loaded.sizes[::-1])
    assert turned.digest != loaded.digest
    refused(text, "count must be a multiple of 2, the number of sizes, got 5")


@pytest.mark.parametrize(
    ("vertices", "line"),
    [
        ("49", "size a: vertices must be at least 50, got 49"),
        ("{ integers = [10, 90] }", "size a: vertices must be at least 50, got 10"),
        ('"many"', "size a: vertices must be a number or one of"),
    ],
)
def test_sizes_that_no_mesh_has_are_refused(vertices, line):
    refused(SIZED.replace("vertices = 500", f"vertices = {vertices}"), line)


def with_protocol(held_out, text=SIZED):
    return f"{text}\n[protocols.mine]\n{held_out}\n"


@pytest.mark.parametrize(
    ("held_out", "folds"),
    [
        ('held_out.sizes = ["a"]', (recipe.Fold("mine", sizes=("a",)),)),
        ('held_out.families = ["sphere"]', (recipe.Fold("mine", families=("sphere",)),)),
        ('held_out = "each family"', (recipe.Fold("mine/sphere", families=("sphere",)),)),
        ('held_out = "nothing"', ()),
    ],
)
def test_recipe_says_what_is_held_out(held_out, folds):
    loaded = recipe.parse(with_protocol(held_out))
    assert loaded.protocols == {"mine": folds}
    assert loaded.digest != recipe.parse(SIZED).digest


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (with_protocol(""), "protocol mine has held_out and nothing else, got {}"),
        (with_protocol("held_out = 3"), "protocol mine: held_out must be 'each family', 'nothing'"),
        (
            with_protocol("held_out = {}"),
            "protocol mine: held_out must be 'each family', 'nothing'",
        ),
        (
            with_protocol('held_out.families = ["cone"]'),
            r"protocol mine: held-out families must be of sphere, got \['cone'\]",
        ),
        (with_protocol("held_out.sizes = []"), r"held-out sizes must be of a, got \[\]"),
        (
            with_protocol('held_out.sizes = ["a"]', TEXT),
            r"protocol mine: held-out sizes must be of none, got \['a'\]",
        ),
        (SIZED + "\n[protocols.grouped]\nheld_out = 'nothing'\n", "protocol grouped: the name is"),
        (SIZED + "\n[protocols.'a/b']\nheld_out = 'nothing'\n", "protocol a/b: the name is taken"),
        ("protocols = 3\n" + SIZED, "protocols must be tables, got 3"),
        ("protocols.mine = 3\n" + SIZED, "protocol mine must be a table, got 3"),
    ],
)
def test_protocols_that_make_no_sense_are_refused(text, line):
    refused(text, line)
