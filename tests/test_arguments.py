"""Every public function takes an argument of any form, or refuses it by its name."""

import inspect
import re

import click
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from click.testing import CliRunner

import shjax
from shjax.cli.convert import convert
from shjax.cli.estimate import estimate
from shjax.cli.light import light
from shjax.cli.reflect import reflect
from shjax.cli.remap import remap
from shjax.cli.render import render_command
from shjax.cli.score import score

SIZES = {
    "K": 9,
    "K1": 9,
    "K2": 9,
    "C": 3,
    "D": 3,
    "L": 3,
    "P": 2,
    "N": 4,
    "V": 4,
    "H": 8,
    "W": 16,
    "n": 2,
    "T": 3,
    "n_theta": 8,
    "n_phi": 16,
}
CHOICES = {
    "l": 2,
    "l_max": 1,
    "p_max": 1,
    "n_theta": 8,
    "n_phi": 16,
    "rms_error": 0.1,
    "lobe": "radial",
    "albedo": 0.5,
    "roughness": 0.5,
    "angle": 0.3,
    "max_lights": 1,
}


# Annotations that stand for an array or an object, and the shape of the array.
ALIASES = {"Light": (8, 16, 3), "BrdfCoefs": (2, 2, 2, 3)}


def _called(parameter):
    """The word that a message says of an argument."""
    return parameter.name.removesuffix("_or_surface").removesuffix("_or_lighting")


def _given(parameter):
    """An argument by its annotation: an array of the shape that this names."""
    text = str(parameter.annotation)
    found = re.search(r"Float\[(?:Array|np\.ndarray), ('[^']*'|\.\.\.)\]", text)
    if found:
        named = "3" if found[1] == "..." else found[1].strip("'")
        sizes = [SIZES.get(n, n) for n in named.split() if not n.startswith("*")]
        array = np.ones([int(n) for n in sizes], np.float32)
        return array / np.sqrt(array.shape[-1]) if array.ndim else array  # unit vectors
    if text in ALIASES:
        return np.ones(ALIASES[text], np.float32)
    if parameter.name == "brdf":
        return shjax.brdf.lambertian()
    if parameter.name == "reflection_map":
        coefs = np.ones((4, 8, 4, 3), np.float32)
        return shjax.ReflectionMap.from_coefs(coefs, frame="global")
    if parameter.name == "expansion":
        return shjax.brdf.expand(shjax.brdf.lambertian(), l_max=2, p_max=1)
    if parameter.name == "lights":
        return shjax.lights.cap_light(jnp.eye(3)[2], 0.1, jnp.ones(3))
    if "AreaLight" in text:
        return shjax.lights.sphere([0, 0, 3], 1.0, 1.0)
    if parameter.name == "light":
        return shjax.prefilter_light(np.ones((9, 3), np.float32), maps=4, max_lights=0)
    return CHOICES[parameter.name]


MODULES = (shjax, shjax.reflection, shjax.lights, shjax.brdf)
# Told of differently, or not of arrays that a user makes.
LEFT_OUT = {"fit_views", "from_samples", "from_table", "transfer", "take_lights"}


def _functions():
    """Every public function of arrays, once."""
    found = {}
    for module in MODULES:
        for name in (n for n in dir(module) if n[0] != "_" and n not in LEFT_OUT):
            function = getattr(module, name)
            if inspect.isfunction(inspect.unwrap(function)):
                found.setdefault(name, function)
    return found


def _arrays():
    for name, function in _functions().items():
        parameters = inspect.signature(function).parameters.values()
        needed = [p for p in parameters if p.default is p.empty]
        for one in needed:
            annotation = str(one.annotation)
            if "Float[" in annotation or annotation in ALIASES:
                long = [pytest.mark.slow] if name == "estimate_joint" else []
                yield pytest.param(
                    function, needed, one, id=f"{name}-{one.name}", marks=long
                )


def _refusal(function, given) -> str | None:
    try:
        function(**given)
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize(("function", "needed", "one"), list(_arrays()))
@pytest.mark.usefixtures("as_a_user")
def test_a_list_serves_or_is_refused_by_name(function, needed, one):
    given = {p.name: _given(p) for p in needed}
    given[one.name] = given[one.name].tolist()
    said = f"{_called(one)}[a-z_]* must be a JAX or NumPy array; got list."
    refusal = _refusal(function, given)
    assert refusal is None or re.fullmatch(said, refusal), refusal


def _read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


# What is done to an argument, and whether its values are still the same light.
FORMS = {
    "integers": (lambda a: np.ones_like(a, np.int32), False),
    "8 bits": (lambda a: np.ones_like(a, np.uint8), False),
    "booleans": (lambda a: np.ones_like(a, bool), False),
    "complex": (lambda a: a.astype(np.complex64), False),
    "half": (lambda a: a.astype(np.float16), True),
    "no axis": (lambda a: np.ones((), np.float32), True),
    "empty": (lambda a: a[..., :0] if a.ndim else a, True),
    "empty in front": (lambda a: a[:0] if a.ndim else a, True),
    "an axis less": (lambda a: a[0] if a.ndim else a, True),
    "an axis more": (lambda a: a[None], True),
    "read-only": (_read_only, True),
    "strided": (lambda a: np.repeat(a, 2, axis=0)[::2] if a.ndim else a, True),
    "nothing": (lambda a: None, False),
}


@pytest.mark.parametrize(("function", "needed", "one"), list(_arrays()))
@pytest.mark.usefixtures("as_a_user")
def test_any_form_serves_or_is_refused_by_name(function, needed, one):
    """Never a traceback from elsewhere, and never integers taken for light."""
    given = {p.name: _given(p) for p in needed}
    plain = _refusal(function, given)
    for form, (change, may_serve) in FORMS.items():
        said = _refusal(function, given | {one.name: change(given[one.name])})
        if said is None:
            assert may_serve, form
        else:
            assert _called(one).rstrip("s") in said or said == plain, (form, said)


# What stands in for itself when it is traced, and forms that are refused then, too.
TRACED = ("the same", "integers", "8 bits", "an axis less")


@pytest.mark.parametrize(("function", "needed", "one"), list(_arrays()))
@pytest.mark.parametrize("by", ["jit", "vmap"])
@pytest.mark.usefixtures("as_a_user")
def test_traced_arguments_serve_or_are_refused_by_name(function, needed, one, by):
    """By tracing alone: nothing is compiled."""
    given = {p.name: _given(p) for p in needed}
    own = given.pop(one.name)
    plain = _refusal(function, given | {one.name: own})

    def leaves(array):
        found = jax.tree.leaves(function(**given, **{one.name: array}))
        return [leaf for leaf in found if isinstance(leaf, jax.Array)]

    for form in TRACED if by == "jit" else TRACED[:2]:
        array = own if form == "the same" else FORMS[form][0](own)
        call = leaves if by == "jit" else jax.vmap(leaves)
        try:
            jax.eval_shape(call, array if by == "jit" else np.stack([array] * 2))
        except ValueError as error:
            said = str(error)
            assert _called(one).rstrip("s") in said or said == plain, (form, said)
            assert form != "the same" or "must be known" in said or said == plain, said


COMMANDS = {
    "light": light,
    "reflect": reflect,
    "render": render_command,
    "estimate": estimate,
    "score": score,
    "convert": convert,
    "remap": remap,
}
TEXTS = (
    "",
    "nan",
    "-1",
    "0",
    "1e999",
    "1,2",
    "1,2,x",
    "abc",
    "\u00e4 b=",
    "a=",
    "99999999999999999999",
)


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.usefixtures("as_a_user")
def test_any_text_of_an_option_is_taken_or_refused_by_name(name, tmp_path, monkeypatch):
    """Before anything is read: the inputs are not there, and are what is left to say."""
    monkeypatch.chdir(tmp_path)
    command = COMMANDS[name]
    gone = [str(tmp_path / f"gone{k}.exr") for k in range(2)]
    for option in command.params:
        if not isinstance(option, click.Option) or option.is_flag:
            continue
        for text in TEXTS:
            places = [p for p in command.params if isinstance(p, click.Argument)]
            call = [*gone[: len(places)], f"{option.opts[-1]}={text}"]
            if any("--out" in p.opts for p in command.params) and option.name != "out":
                call += ["--out", str(tmp_path / "out")]
            run = CliRunner().invoke(command, call)
            told = f"{call}: {run.exception!r}\n{run.output}"
            assert run.exit_code != 0, told
            if isinstance(run.exception, SystemExit):
                assert run.exit_code == 2, told
                assert "Error" in run.output, told
            else:
                assert isinstance(run.exception, (OSError, ValueError)), told
                assert not isinstance(run.exception, UnicodeError), told
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda e, b: shjax.prefilter(e, b), "envmap.lighting"),
        (lambda e, b: shjax.tone_map(e), "envmap.radiance"),
        (lambda e, b: shjax.prefilter(np.ones((9, 3), np.float32), b), "brdf.expand"),
        (lambda e, b: shjax.reference_reflection(e, (b, 1), *FACING), "read_cornell"),
        (lambda e, b: shjax.choose_model(e, (b, 1), rms_error=0.1), "read_cornell"),
        (lambda e, b: shjax.brdf.check((b, 1)), "read_cornell"),
        (lambda e, b: shjax.reflection.fit_low_rank((b, 1)), "read_cornell"),
        (lambda e, b: shjax.window(np.ones(3), "hann"), "name must be .* got ndarray"),
        (
            lambda e, b: shjax.prefilter(NINE, expansion(31)),
            "lighting and rho .* 3 and 31",
        ),
        (
            lambda e, b: shjax.convert(np.ones((9, 3), np.float32), "4"),
            "to must be one",
        ),
    ],
)
def test_the_error_says_what_to_pass_instead(call, words):
    envmap = shjax.make_envmap(np.ones((16, 32, 3), np.float32))
    with pytest.raises(ValueError, match=words):
        call(envmap, shjax.brdf.lambertian(0.5))


FACING = (np.array([[0, 0, 1]], np.float32),) * 2
NINE = np.ones((9, 3), np.float32)


def expansion(channels):
    return shjax.brdf.expand(shjax.brdf.lambertian([0.5] * channels), l_max=2, p_max=2)


def test_a_texture_of_one_channel_is_a_roughness():
    light = shjax.prefilter_light(NINE)
    normals, views = (np.broadcast_to(a, (2, 3, 3)) for a in FACING)
    rough = np.linspace(0.3, 0.8, 6, dtype=np.float32).reshape(2, 3)
    for name in ("roughness", "metallic"):
        given = {"albedo": 0.5, "roughness": 0.5, "metallic": 0.2}
        flat = shjax.shade(light, normals, views, **{**given, name: rough})
        deep = shjax.shade(light, normals, views, **{**given, name: rough[..., None]})
        np.testing.assert_array_equal(deep, flat)


def test_lights_of_an_ambiguous_shape_take_an_axis_in_front():
    """n lights of 2 n coefficients have the shape of a panorama."""
    batch = np.ones((18, 36, 3), np.float32)
    assert shjax.prefilter_light(batch).texels.ndim == 3
    assert shjax.prefilter_light(batch[None]).texels.shape[:2] == (1, 18)


def test_a_gbuffer_is_described_in_one_line():
    ball = shjax.render.sphere(4)
    assert repr(ball) == "GBuffer: 4 x 4; normals, mask, views, albedo, positions"


@pytest.mark.usefixtures("as_a_user")
def test_a_lit_material_is_no_brdf():
    light = shjax.prefilter_light(np.ones((16, 32, 3), np.float32))
    lit = light.with_material(albedo=0.5, roughness=0.5)
    with pytest.raises(ValueError, match="metallic_roughness"):
        shjax.reference_reflection(np.ones((16, 32, 3), np.float32), lit, *FACING)
    gradient = jax.grad(lambda one: jnp.sum(one.radiance(*FACING)))(lit)
    assert "LitMaterial" in repr(gradient)


def test_brdfs_add_and_divide():
    grey = shjax.brdf.lambertian(0.5)
    total = sum([grey, grey]) / 2
    assert [float(part.weight[0]) for part in total.parts] == [0.5, 0.5]
    assert repr(total) == "Brdf: lambertian + lambertian, 1 channel"
    with pytest.raises(TypeError):
        _ = 1 + grey


@pytest.mark.parametrize("name", ["three", "threejs", "Three.js"])
def test_three_has_its_usual_names(name, tmp_path):
    nine = np.arange(27, dtype=np.float32).reshape(9, 3)
    exact = np.asarray(shjax.convert(nine, to="three.js"))
    np.testing.assert_array_equal(shjax.convert(nine, name), exact)
    shjax.io.write_coefs(tmp_path / "a.json", nine, name)
    assert "LightProbe" in (tmp_path / "a.json").read_text()
    paths = [str(tmp_path / "a.json"), str(tmp_path / "b.json")]
    assert CliRunner().invoke(convert, [*paths, "--to", name]).exit_code == 0
