"""Meshes by ray casting; pictures of spheres and meshes beside another renderer's."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.vectors
from shjax import brdf, io, render
from shjax.envmap import make_envmap
from shjax.reflection.view_sum import mean_view
from shjax.render.loading import load_mesh
from shjax.render.meshes import trace_mesh, visibility
from tests.helpers import check_gradients, relative_error, unit_vectors
from tests.mitsuba import FRONT, environment

trimesh = pytest.importorskip("trimesh")


@pytest.fixture
def ball_file(tmp_path):
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=5).export(path)
    return path


@pytest.mark.parametrize("fov", [None, 0.7])
def test_a_ball_of_triangles_is_the_ball(ball_file, fov):
    camera = render.Camera(origin=(3.0, -2.0, 1.5), fov=fov)
    mesh, exact = render.mesh(ball_file, camera, 48), render.sphere(48, camera)
    assert abs(float(jnp.sum(mesh.mask - exact.mask))) < 0.005 * float(
        jnp.sum(exact.mask)
    )
    whole = np.asarray((mesh.mask == 1) & (exact.mask == 1))
    facing = np.asarray(jnp.sum(exact.normals * exact.views, -1)) > 0.3
    cosine = np.sum(np.asarray(mesh.normals) * np.asarray(exact.normals), -1)[
        whole & facing
    ]
    assert np.min(cosine) > np.cos(np.radians(1.5))
    np.testing.assert_allclose(mesh.views[whole], exact.views[whole], atol=1e-5)
    outside = np.asarray(mesh.mask) == 0
    assert np.all(np.asarray(mesh.normals)[outside] == 0)


@pytest.mark.parametrize("kind", ["obj", "off", "ply"])
def test_files(tmp_path, kind):
    path = tmp_path / f"cube.{kind}"
    trimesh.creation.box().export(path)
    buffer = render.mesh(path, render.Camera(origin=(4.0, 0.0, 0.0), width=2.0), 8)
    assert np.asarray(buffer.mask).sum() == pytest.approx(16)
    np.testing.assert_allclose(
        np.linalg.norm(buffer.normals, axis=-1)[3, 3], 1, rtol=1e-5
    )


def test_what_is_no_mesh_is_refused_by_name(tmp_path):
    (tmp_path / "empty.obj").write_text("")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    (tmp_path / "noise.ply").write_bytes(b"\x00\x01ply rubbish")
    for name in ("empty.obj", "points.obj", "noise.ply"):
        with pytest.raises(ValueError, match=name):
            load_mesh(tmp_path / name)
    with pytest.raises(OSError, match="gone"):
        load_mesh(tmp_path / "gone.obj")
    with pytest.raises(ValueError, match="size must be positive"):
        render.mesh(tmp_path / "gone.obj", render.Camera(), 0)


def test_visibility_knows_what_is_in_the_way():
    floor = trimesh.creation.box((4, 4, 0.1))
    wall = trimesh.creation.box((0.1, 4, 3)).apply_translation((-1.0, 0, 1.5))
    scene = trimesh.util.concatenate([floor, wall])
    camera = render.Camera(
        origin=(0.5, 0.0, 6.0), target=(0.5, 0.0, 0.0), up=(0.0, 1.0, 0.0), width=0.5
    )
    trace = trace_mesh(scene, camera, 4)
    directions = np.array(
        [[0.0, 0, 1], [1, 0, 0.3], [-1, 0, 0.3], [0, 0, -1], [0.0, 1, 0.2]]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    seen = visibility(trace, directions)
    assert seen.shape == (4, 4, 5)
    np.testing.assert_array_equal(seen[2, 2], [True, True, False, False, True])


def _rms(picture, truth, where):
    off = np.sum((np.asarray(picture) - truth)[where] ** 2)
    return float(np.sqrt(off / np.sum(truth[where] ** 2)))


GLOSSY = {
    "phongLW_n20": brdf.phong_cosine(20.0),
    "phongRH_n20": brdf.phong(20.0, horizon=True),
    "ggx_a0.2": brdf.ggx(0.2, 1.0),
    "ggx_a0.4": brdf.ggx(0.4, 1.0),
    "mixLW_kd.6_ks.3_n30": brdf.lambertian(0.6) + 0.3 * brdf.phong_cosine(30.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("light", ["real_city", "band4"])
@pytest.mark.parametrize("name", GLOSSY)
def test_glossy_spheres_beside_mitsubas(name, light, data):
    """Within the pictures' own noise, seen against the integral, and the predicted error."""
    renders, model = data / "renders", GLOSSY[name]
    panorama = environment(renders, light)
    truth = io.read_image(renders / "glossy" / f"sphere_{name}_{light}_front.exr")
    ball = render.sphere(128, FRONT)
    facing = jnp.sum(ball.normals * ball.views, -1) > 0.3  # not a pixel's mixed outline
    where = np.asarray((ball.mask == 1) & facing)
    noise = _rms(render.reference(ball, jnp.asarray(panorama), model), truth, where)
    assert noise < 0.025
    chosen = shjax.choose_model(make_envmap(panorama), model, rms_error=0.05)
    found = _rms(render.image(ball, chosen), truth, where)
    assert chosen.met
    assert found < noise + chosen.predicted_rms_error


@pytest.mark.parametrize("name", ["bunny", "spot"])
def test_meshes_beside_mitsubas(name, data):
    """Normals of embree's hits, coverage, and the matte picture (its albedo is 0.8)."""
    renders = data / "renders"
    geometry = load_mesh(renders / "meshes" / f"{name}.ply")
    geometry.vertices = np.asarray(geometry.vertices)[:, [2, 0, 1]]
    trace = trace_mesh(geometry, FRONT, 128, albedo=0.8)
    inside = np.asarray(trace.gbuffer.mask) == 1
    theirs = io.read_image(renders / "aov" / f"{name}_front_normal.exr")[..., [2, 0, 1]]
    theirs /= np.maximum(np.linalg.norm(theirs, axis=-1, keepdims=True), 1e-9)
    ours = np.asarray(trace.gbuffer.normals)
    angles = np.arccos(np.clip(np.sum(ours * theirs, axis=-1), -1, 1))
    assert np.degrees(np.mean(angles[inside])) < 1
    lighting = shjax.analyze(jnp.asarray(environment(renders, "real_city")), l_max=30)
    truth = io.read_image(renders / "mesh" / f"{name}_real_city_front_noshadow.exr")
    facing = inside & (np.sum(ours * np.asarray(trace.gbuffer.views), axis=-1) > 0.3)
    matte = (
        0.8 / np.pi * shjax.irradiance(lighting, jnp.asarray(theirs, lighting.dtype))
    )
    noise = _rms(matte, truth, facing)  # by their own normals
    assert noise < 0.03
    assert _rms(render.image(trace.gbuffer, lighting), truth, facing) < noise + 0.01


def test_local_global_and_dynamic_pictures_agree(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(36, 3)), dtype)
    rho = shjax.brdf_coefs(brdf.gaussian_microfacet(0.4), l_max=5, p_max=2).astype(
        dtype
    )
    ball = render.sphere(24)  # orthographic: one view
    local = render.image(ball, shjax.prefilter(lighting, rho, n_theta=48, n_phi=96))
    world = shjax.prefilter(lighting, rho, n_theta=48, n_phi=96, frame="global")
    middle = world.for_view(mean_view(ball.views))
    for same in (world, middle):
        assert relative_error(render.image(ball, same), local) < 2e-3
    with pytest.raises(ValueError, match="only a global map"):
        shjax.prefilter(lighting, rho, n_theta=8).for_view(jnp.ones(3))
    exact = shjax.reflection.reflect(
        lighting, rho, shjax.vectors.mirror(ball.normals, ball.views), ball.views
    )
    assert relative_error(local, exact * ball.mask[..., None]) < 2e-3


@pytest.mark.slow
def test_reference_picture_and_model_agree(rng, dtype):
    light = np.zeros((16, 3))
    light[0] = 4.0
    light[1:9] = rng.normal(size=(8, 3)) * 0.3
    panorama = shjax.synthesize(jnp.asarray(light, dtype), n_theta=32, n_phi=64)
    for model, tangents in ((brdf.phong(6.0), False), (brdf.kajiya_kay(4.0), True)):
        ball = render.sphere(20, tangents=tangents)
        chosen = shjax.choose_model(jnp.asarray(light, dtype), model, rms_error=0.01)
        exact = render.reference(ball, panorama, model)
        assert relative_error(render.image(ball, chosen), exact) < 0.03


def test_mirror_and_background_show_the_light(dtype):
    panorama = jnp.zeros((32, 64, 1), dtype).at[:16].set(1.0)  # white above
    camera = render.Camera(origin=(-4.0, 0.0, 0.0), fov=1.0)
    behind = np.asarray(render.background(panorama, camera, 16))
    assert np.all(behind[:7] > 0.95)
    assert np.all(behind[9:] < 0.05)
    reflected = np.asarray(render.mirrored(render.sphere(17), panorama))
    assert reflected[4, 8, 0] > 0.95
    assert reflected[12, 8, 0] < 0.05


@pytest.mark.slow
@pytest.mark.x64
def test_gradients_of_a_rendered_pixel(rng):
    """With respect to light, material, normal and the camera's rotation."""
    lighting = jnp.asarray(rng.normal(size=(25, 3)))
    normal = unit_vectors(rng, 1)
    view = normal + 0.5 * unit_vectors(rng, 1)

    def pixel(light, alpha, f0, n, turn):
        c, s = jnp.cos(turn), jnp.sin(turn)
        z, o = jnp.zeros_like(c), jnp.ones_like(c)
        rotation = jnp.stack(
            [jnp.stack([c, -s, z]), jnp.stack([s, c, z]), jnp.stack([z, z, o])]
        )
        v = shjax.vectors.normalize(jnp.asarray(view) @ rotation.T)
        buffer = render.make_gbuffer(n[None], views=v[None], albedo=0.7)
        rho = shjax.brdf_coefs(brdf.ggx(alpha, f0), l_max=4, p_max=2)
        maps = shjax.prefilter(light, rho, n_theta=16, n_phi=32)
        return render.image(buffer, maps)

    check_gradients(
        pixel,
        lighting,
        jnp.asarray(0.4),
        jnp.asarray(0.3),
        jnp.asarray(normal),
        jnp.asarray(0.2),
        tolerance=1e-6,
    )


@pytest.fixture
def textured_file(tmp_path):
    """A square facing +x in glTF, red left of black, rough above smooth."""
    from PIL import Image

    colours = np.zeros((2, 2, 3), np.uint8)
    colours[:, 0] = [188, 0, 0]  # sRGB of linear 0.503
    packed = np.zeros((2, 2, 3), np.uint8)
    packed[0, :, 1], packed[1, :, 1], packed[..., 2] = 255, 51, 102
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(colours).resize((64, 64), Image.NEAREST),
        metallicRoughnessTexture=Image.fromarray(packed).resize(
            (64, 64), Image.NEAREST
        ),
        roughnessFactor=0.5,
        metallicFactor=1.0,
    )
    square = trimesh.Trimesh(
        vertices=[[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]],
        faces=[[0, 1, 2], [0, 2, 3]],
        visual=trimesh.visual.TextureVisuals(
            uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=material
        ),
        process=False,
    )
    path = tmp_path / "square.glb"
    square.export(path)
    return path


def test_textures_of_a_mesh(textured_file):
    """Seen from +x, +y is on the right: red on the left, rough above."""
    camera = render.Camera(origin=(3.0, 0.0, 0.0), width=2.0)
    seen = render.mesh(textured_file, camera, 16, material=True)
    assert float(seen.mask.min()) > 0.9
    columns = np.asarray(seen.albedo)[8]
    first = np.flatnonzero(columns[:, 0] > 0.4)
    red, black = (0, 15) if 0 in first else (15, 0)
    np.testing.assert_allclose(columns[red], [0.503, 0, 0], atol=0.01)
    np.testing.assert_allclose(columns[black], 0, atol=0.01)
    right = np.cross([-1.0, 0, 0], [0, 0, 1.0])  # of the camera
    assert (red == 0) == (right[1] > 0)
    np.testing.assert_allclose(seen.roughness[2], 0.5, atol=0.01)
    np.testing.assert_allclose(seen.roughness[13], 0.1, atol=0.01)
    np.testing.assert_allclose(seen.metallic, 0.4, atol=0.01)
    plain = render.mesh(textured_file, camera, 8)
    assert plain.roughness is None
    light = shjax.prefilter_light(
        jnp.full((1, 3), np.sqrt(4 * np.pi), seen.albedo.dtype), maps=4
    )
    picture = np.asarray(render.image(seen, light))
    assert picture[8, red, 0] > 5 * picture[8, black, 0]
    with pytest.raises(ValueError, match="the G-buffer has none"):
        render.image(plain, light)


def test_a_mesh_without_material_is_refused(ball_file):
    with pytest.raises(ValueError, match="material must be in the file"):
        render.mesh(ball_file, render.Camera(), 8, material=True)


def _two_faces(colours, **material):
    """Two faces of a cube in glTF, their normals their own, with vertex colours."""
    box = trimesh.creation.box().triangles[[0, 4]].reshape(-1, 3)
    normals = np.cross(box[1::3] - box[::3], box[2::3] - box[::3])
    normals = np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), 3, 0)
    mesh = trimesh.Trimesh(
        box, [[0, 1, 2], [3, 4, 5]], vertex_normals=normals, process=False
    )
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((6, 2)),
        material=trimesh.visual.material.PBRMaterial(name="m", **material),
    )
    scene = trimesh.Scene(mesh)
    files = trimesh.exchange.gltf.export_gltf(scene, include_normals=True)
    return files, colours, normals


def _written(folder, files, colours, change):
    """The glTF with COLOR_0 as the file's own floats, and its JSON changed."""
    document = json.loads(files.pop("model.gltf"))
    document["buffers"].append(
        {"uri": "colours.bin", "byteLength": colours.astype("<f4").nbytes}
    )
    files["colours.bin"] = colours.astype("<f4").tobytes()
    document["bufferViews"].append(
        {"buffer": len(document["buffers"]) - 1, "byteLength": colours.size * 4}
    )
    document["accessors"].append(
        {
            "bufferView": len(document["bufferViews"]) - 1,
            "componentType": 5126,
            "count": len(colours),
            "type": "VEC3",
        }
    )
    one = document["meshes"][0]["primitives"][0]
    one["attributes"]["COLOR_0"] = len(document["accessors"]) - 1
    change(document, one)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    path = folder / "model.gltf"
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("material", [True, False])
def test_colours_and_normals_of_a_gltf_are_its_own(tmp_path, material):
    """COLOR_0 times a dark factor, in the file's own bits; a hard edge stays one."""
    colours = np.tile([0.001, 0.5, 0.25], (6, 1))

    def change(document, primitive):
        if material:
            own = document["materials"][0]["pbrMetallicRoughness"]
            own["baseColorFactor"] = [0.5, 0.0003, 1.0, 1.0]
            document["materials"][0]["emissiveFactor"] = [1, 0, 0]
        else:
            del primitive["material"]

    files, colours, normals = _two_faces(colours, baseColorFactor=[128, 0, 255, 255])
    path = _written(tmp_path, files, colours, change)
    mesh = load_mesh(path)
    got = np.asarray(mesh.vertex_normals)[np.asarray(mesh.faces)].reshape(-1, 3)
    np.testing.assert_allclose(got, normals, atol=1e-6)
    where, triangle = np.asarray(mesh.triangles).mean(axis=1), 0
    camera = render.Camera(
        origin=where[triangle] + 3 * normals[0],
        target=where[triangle],
        up=(0.3, 0.5, 0.8),
        width=0.05,
    )
    expected = [0.0005, 0.00015, 0.25] if material else colours[0]
    if material:
        with pytest.warns(UserWarning, match="not drawn .* emissiveFactor"):
            seen = render.mesh(path, camera, 3, material=True)
    else:
        seen = render.mesh(path, camera, 3, material=True)
    np.testing.assert_allclose(seen.albedo[1, 1], expected, rtol=1e-5)


def test_colours_of_a_ply_are_a_pictures(tmp_path):
    ball = trimesh.creation.icosphere()
    ball.visual.vertex_colors = np.tile([188, 0, 255, 255], (len(ball.vertices), 1))
    ball.export(tmp_path / "ball.ply")
    seen = render.mesh(
        tmp_path / "ball.ply", render.Camera((3.0, 0, 0)), 3, material=True
    )
    np.testing.assert_allclose(seen.albedo[1, 1], [0.503, 0, 1], atol=1e-3)
    np.testing.assert_allclose(seen.metallic[1, 1], 0)


def test_parts_keep_their_own_materials(tmp_path):
    """Two instances of two materials, one mirrored: colours stay on their side."""
    scene = trimesh.Scene()
    for k, colour in enumerate(([255, 0, 0, 255], [0, 0, 255, 255])):
        ball = trimesh.creation.icosphere(radius=0.5)
        ball.visual = trimesh.visual.TextureVisuals(
            uv=np.zeros((len(ball.vertices), 2)),
            material=trimesh.visual.material.PBRMaterial(baseColorFactor=colour),
        )
        place = np.diag([1.0, -1.0, 1.0, 1.0]) if k else np.eye(4)
        place[1, 3] = 1.0 - 2 * k
        scene.add_geometry(ball, transform=place)
    scene.export(tmp_path / "two.glb")
    seen = render.mesh(
        tmp_path / "two.glb", render.Camera((4.0, 0, 0), width=3.0), 12, material=True
    )
    inside = np.asarray(seen.mask) == 1
    # Seen from +x with z up, +y is on the right.
    for side, colour in ((slice(7, 12), [1, 0, 0]), (slice(0, 5), [0, 0, 1])):
        part = np.asarray(seen.albedo)[:, side][inside[:, side]]
        np.testing.assert_allclose(part, np.tile(colour, (len(part), 1)), atol=1e-6)
    facing = np.sum(np.asarray(seen.normals) * np.asarray(seen.views), -1)
    assert np.all(facing[inside] > 0)
