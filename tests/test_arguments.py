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
    "K": 9, "K1": 9, "K2": 9, "C": 3, "D": 3, "L": 3, "P": 2, "N": 4, "V": 2, "H": 8,
    "W": 16, "n_theta": 8, "n_phi": 16,
}  # fmt: skip
CHOICES = {
    "l": 2, "l_max": 1, "p_max": 1, "n_theta": 8, "n_phi": 16, "rms_error": 0.1,
    "energy_error": 0.1, "model": "radial", "albedo": 0.5, "roughness": 0.5,
}  # fmt: skip


def _given(parameter):
    """An argument by its annotation: an array of the shape that this names."""
    text = str(parameter.annotation)
    found = re.match(r"(?:\w+ \| )*Float\[Array, ('[^']*'|\.\.\.)\]", text)
    if found:
        named = "3" if found[1] == "..." else found[1].strip("'")
        sizes = [SIZES.get(n, n) for n in named.split() if not n.startswith("*")]
        array = np.ones([int(n) for n in sizes], np.float32)
        return array / np.sqrt(array.shape[-1]) if array.ndim else array  # unit vectors
    if parameter.name == "brdf":
        return shjax.brdf.lambertian()
    if parameter.name == "expansion":
        return shjax.expand_brdf(shjax.brdf.lambertian(), l_max=2, p_max=1)
    if parameter.name == "lights":
        return shjax.lights.cap_light(jnp.eye(3)[2], 0.1, jnp.ones(3))
    if parameter.name == "light":
        return shjax.prefilter_light(np.ones((9, 3), np.float32), maps=4, max_lights=0)
    return CHOICES[parameter.name]


def _arrays():
    for name in dir(shjax):
        function = getattr(shjax, name)
        if inspect.isfunction(inspect.unwrap(function)) and name[0] != "_":
            parameters = inspect.signature(function).parameters.values()
            needed = [p for p in parameters if p.default is p.empty]
            for one in needed:
                if "Float[" in str(one.annotation):
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
    said = f"{one.name} must be a JAX or NumPy array; got list."
    assert _refusal(function, given) in (None, said)


def _read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


# What is done to an argument, and whether its values are still the same light.
FORMS = {
    "whole numbers": (lambda a: np.ones_like(a, np.int32), False),
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
            assert one.name.rstrip("s") in said or said == plain, (form, said)


# What stands in for itself when it is traced, and forms that are refused then, too.
TRACED = ("the same", "whole numbers", "8 bits", "an axis less")


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
            assert one.name.rstrip("s") in said or said == plain, (form, said)
            assert form != "the same" or "must be known" in said or said == plain, said


COMMANDS = {
    "light": light, "reflect": reflect, "render": render_command, "estimate": estimate,
    "score": score, "convert": convert, "remap": remap,
}  # fmt: skip
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
