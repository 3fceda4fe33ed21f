"""Shaders are compiled by the compilers and executed by the adapters that are there.

Which of them ran is in the names of the tests; `.ci/tools` installs them.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.export import LANGUAGES, records, shader, write_binary
from alsarr.tables import (
    Certificate,
    Conditions,
    Domain,
    Eq31,
    Eq31LogTravel,
    QualityTables,
    TensorPolynomial,
)
from camojab import Display, pool, Pooled, pooled_quality, Shading, Spectrum, Viewing


SIDES = ("4", "2", "1")
SUFFIX = {"hlsl": ".hlsl", "glsl450": ".comp", "glsl310es": ".comp", "wgsl": ".wgsl"}
GLSLANG = {
    "hlsl": ["-V", "-D", "-S", "comp", "-e", "main"],
    "glsl450": ["-V", "-S", "comp"],
    "glsl310es": ["-V", "-S", "comp"],
}
TOOLS = Path(__file__).parents[2] / ".tools" / "bin"


def lacking(reason):
    """Skip, but where everything is said to be installed, fail."""
    if os.environ.get("CI") == "true" and sys.platform == "linux":
        pytest.fail(reason)
    pytest.skip(reason)


def compiler(name):
    path = shutil.which(name) or shutil.which(name, path=str(TOOLS))
    return path or lacking(f"{name} is not installed; .ci/tools installs it")


def succeed(*command):
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def sampled():
    """Qualities of the model where they are largest: for white noise."""
    rng = np.random.default_rng(0)
    n = 400
    at = Conditions(
        velocity=jnp.asarray(rng.random(n) ** 2 * 50, float),
        refresh_rate=jnp.asarray(30 * 4 ** rng.random(n), float),
        log10_luminance=jnp.asarray(rng.uniform(-1, 2.5, n), float),
    )
    display = Display(
        ppd=60.0, refresh_rate=at.refresh_rate, luminance=10.0**at.log10_luminance
    )
    spectrum = Spectrum.from_texture(jnp.asarray(rng.random((512, 512)), float))

    def evaluate(rate_x, rate_y, mip_level):
        shading = Shading(rate_x=rate_x, rate_y=rate_y, mip_level=mip_level)
        pooled = pool(spectrum, shading, fidelity=Pooled(2000))
        return pooled_quality(pooled, display, Viewing(at.velocity))

    quality = np.array(
        [
            [evaluate(float(x), float(y), mip) for x, y in RATES.resolution]
            for mip in (0.0, 1.0, 2.0)
        ]
    )
    return at, quality - quality[:, :1]


def made(sampled, basis, rates, directions, domain):
    """Tables of two textures and three levels, fitted to the model."""
    at, quality = sampled
    quality = quality[:, :: 3 if rates == SIDES else 1]
    shape = (2, 3, len(rates), directions)
    # Directions and textures differ by factors, so that none can stand for another.
    factor = np.array([[1.0, 0.7], [0.9, 0.4]])[:, None, None, :directions]
    wanted = quality[None, :, :, None] * factor[..., None]
    fitted = basis.fit(at, jnp.asarray(wanted.reshape(-1, wanted.shape[-1])), domain)
    errors = np.zeros((6, len(rates), directions))
    return QualityTables(
        coefficients=np.float32(fitted).reshape(6, *shape[2:], -1),
        entry=np.arange(6).reshape(2, 3),
        occurs=np.ones((2, 3), bool),
        constant=np.zeros(6, bool),
        mip_levels=(0, 1, 2),
        domain=domain,
        certificate=Certificate(
            largest=errors,
            percentile_99=errors,
            median=errors,
            overall=np.zeros(3),
            sample=at,
        ),
        basis=basis,
        rates=rates,
        texture_names=("noise", "fainter"),
        model="white noise */ on\na \\",
        relative_to=rates[0],
    )


# The last is for one refresh rate and does not depend on luminance.
CASES = {
    "eq31": (Eq31(), RATES.names, 2, Domain()),
    "travel": (Eq31LogTravel(), RATES.names, 1, Domain()),
    "tensor": (TensorPolynomial((5, 2, 4), 1 / 120), SIDES, 2, Domain()),
    "narrow": (
        TensorPolynomial((3, 1, 0), 1 / 120),
        SIDES,
        1,
        Domain(refresh_rate=(60.0, 60.0)),
    ),
}


@pytest.fixture(scope="module")
def tables(sampled):
    return {name: made(sampled, *case) for name, case in CASES.items()}


@pytest.fixture(scope="module")
def sources(tables, tmp_path_factory):
    """A file for each case and language."""
    folder = tmp_path_factory.mktemp("shaders")
    paths = {}
    for name, case in tables.items():
        for language in LANGUAGES:
            path = folder / f"{name}-{language}{SUFFIX[language]}"
            path.write_text(shader(case, language), encoding="ascii")
            paths[name, language] = path
    return paths


def to_spirv(path, language):
    made = path.with_suffix(".spv")
    succeed(compiler("glslangValidator"), *GLSLANG[language], path, "-o", made)
    return made


@pytest.mark.parametrize("language", GLSLANG)
@pytest.mark.parametrize("case", CASES)
def test_glslang_compiles_to_valid_spirv(sources, case, language):
    spirv = to_spirv(sources[case, language], language)
    succeed(compiler("spirv-val"), "--target-env", "vulkan1.0", spirv)


@pytest.mark.parametrize("language", ["glsl450", "glsl310es"])
@pytest.mark.parametrize("case", CASES)
def test_glslang_takes_glsl_for_opengl_too(sources, case, language):
    succeed(compiler("glslangValidator"), "-S", "comp", sources[case, language])


@pytest.mark.parametrize("language", ["glsl450", "wgsl"])
@pytest.mark.parametrize("case", CASES)
def test_naga_validates(sources, case, language):
    glsl = ["--input-kind", "glsl", "--shader-stage", "compute"]
    options = glsl if language == "glsl450" else []
    succeed(compiler("naga"), *options, sources[case, language])


def adapters():
    try:
        import wgpu
    except ImportError:
        return {}
    found = wgpu.gpu.enumerate_adapters_sync()
    return {a.info["backend_type"]: a for a in found if a.info["adapter_type"] == "CPU"}


@pytest.fixture(scope="module")
def devices():
    return {name: a.request_device_sync() for name, a in adapters().items()}


TILE = np.dtype(
    [
        ("texture_index", "<u4"),
        ("mip_level", "<f4"),
        ("velocity_x", "<f4"),
        ("velocity_y", "<f4"),
        ("luminance", "<f4"),
    ]
)


def execute(device, source, records, tiles, refresh_rates):
    """Qualities [refresh rates, tiles, 7], as an engine would have them computed."""
    import wgpu

    module = device.create_shader_module(code=source, label="comp")
    stage = {"module": module, "entry_point": "main"}
    pipeline = device.create_compute_pipeline(layout="auto", compute=stage)
    usage, n = wgpu.BufferUsage, len(tiles)
    frame = device.create_buffer(size=16, usage=usage.UNIFORM | usage.COPY_DST)
    # One tile more than is asked for, which must stay as it is.
    buffers = [
        device.create_buffer_with_data(data=records, usage=usage.STORAGE),
        device.create_buffer_with_data(data=tiles.tobytes(), usage=usage.STORAGE),
        frame,
        device.create_buffer(size=(n + 1) * 28, usage=usage.STORAGE | usage.COPY_SRC),
    ]
    group = device.create_bind_group(
        layout=pipeline.get_bind_group_layout(0),
        entries=[
            {"binding": i, "resource": {"buffer": b, "offset": 0, "size": b.size}}
            for i, b in enumerate(buffers)
        ],
    )
    qualities = []
    for refresh_rate in refresh_rates:
        header = np.float32(refresh_rate).tobytes() + np.uint32(n).tobytes() + bytes(8)
        device.queue.write_buffer(frame, 0, header)
        encoder = device.create_command_encoder()
        compute = encoder.begin_compute_pass()
        compute.set_pipeline(pipeline)
        compute.set_bind_group(0, group)
        compute.dispatch_workgroups(n // 64 + 1)
        compute.end()
        device.queue.submit([encoder.finish()])
        data = np.frombuffer(device.queue.read_buffer(buffers[3]), np.float32)
        np.testing.assert_array_equal(data[7 * n :], 0)
        qualities.append(data[: 7 * n].reshape(n, 7))
    return np.stack(qualities)


def drawn_tiles(textures, n=1000):
    """Conditions inside of the domain, at its edge, and outside."""
    rng = np.random.default_rng(1)
    tiles = np.zeros(n, TILE)
    tiles["texture_index"] = rng.integers(0, textures, n)
    tiles["mip_level"] = rng.uniform(0, 4, n)
    # Half-way between two levels the finer one is taken.
    tiles["mip_level"][:40] = np.arange(40) % 8 / 2
    for axis in ("velocity_x", "velocity_y"):
        tiles[axis] = rng.random(n) ** 2 * 55
    tiles["velocity_x"][40:50], tiles["velocity_y"][50:60] = 0, 50
    tiles["luminance"] = 10 ** rng.uniform(-2, 3.5, n)
    tiles["luminance"][60:70], tiles["luminance"][70:80] = 0, 1e30
    return tiles


REFRESH_RATES = (20.0, 30.0, 63.3, 120.0, 240.0)


def by_jax(tables, tiles):
    a = lambda name: jnp.asarray(tiles[name], float)
    buffers = ("mip_level", "velocity_x", "velocity_y", "luminance")
    texture = jnp.asarray(tiles["texture_index"].astype(int))
    at = [jnp.asarray(f, float) for f in REFRESH_RATES]
    evaluate = jax.jit(lambda f: tables.quality(texture, *map(a, buffers), f))
    return np.stack([np.asarray(evaluate(f)) for f in at])


def by_numpy(tables, tiles):
    """Written anew in double precision from the coefficients in single precision."""
    found = records(tables)
    table = found.coefficients.astype(float)
    low, high = found.domain.T.astype(float)
    texture = tiles["texture_index"]
    level = np.array([sum(m > b for b in (0.5, 1.5)) for m in tiles["mip_level"]])
    light = tiles["luminance"].astype(float)
    light = np.log10(np.clip(light, 10 ** low[2], 10 ** high[2]))
    result = np.zeros((len(REFRESH_RATES), len(tiles), 7))
    for i, k, d in np.ndindex(len(REFRESH_RATES), 7, 2):
        speed = tiles[("velocity_x", "velocity_y")[d]].astype(float)
        v = np.clip(speed, low[0], high[0])
        f = np.full(v.size, np.clip(np.float32(REFRESH_RATES[i]), low[1], high[1]))
        rate = k if len(found.rates) == 7 else SIDES.index(RATES.names[k][2 * d])
        c = table[min(d, len(table) - 1), texture, level, rate]
        result[i, :, k] += polynomial(found, c, v, f, light) / 2
    return result


def polynomial(found, c, v, f, level):
    if found.basis == "tensor":
        ends = found.domain.astype(float)
        scale = lambda x, e: np.interp(x, e, (-1, 1)) if e[0] < e[1] else 0 * x
        vander = np.polynomial.chebyshev.chebvander
        travel = lambda v, f: np.log(np.maximum(v / f, found.shortest_travel))
        x = vander(
            scale(travel(v, f), travel(ends[0], ends[1][::-1])), found.degrees[0]
        )
        y = vander(scale(np.log(f), np.log(ends[1])), found.degrees[1])
        z = vander(scale(level, ends[2]), found.degrees[2])
        c = c.reshape(-1, *(degree + 1 for degree in found.degrees))
        return np.einsum("nijk,ni,nj,nk->n", c, x, y, z)
    u = np.log1p(v / (0.05 * f)) if found.basis == "eq31-log-travel" else v
    terms = [np.ones_like(u), u, f, u * u, u * f, f * f]
    motion = np.einsum("nt,tn->n", c[:, :6], np.stack(terms))
    light = np.einsum("nt,nt->n", c[:, 6:], np.vander(level, 4))
    return motion * light


@pytest.fixture(scope="module")
def expected(tables):
    tiles = {name: drawn_tiles(2) for name in tables}
    return {
        name: (tiles[name], by_jax(case, tiles[name]), by_numpy(case, tiles[name]))
        for name, case in tables.items()
    }


def test_references_agree(expected):
    largest = 0.0
    for _, in_jax, in_numpy in expected.values():
        np.testing.assert_allclose(in_jax, in_numpy, rtol=0, atol=1e-5)
        largest = max(largest, np.abs(in_numpy).max())
    # Rounding matters where qualities are large, and they are.
    assert largest > 20


ROUTES = {
    "wgsl": ("wgsl", False),
    "glsl450": ("glsl450", False),
    "glsl450-spirv": ("glsl450", True),
    "glsl310es-spirv": ("glsl310es", True),
    "hlsl-spirv": ("hlsl", True),
}


@pytest.mark.parametrize("adapter", ["Vulkan", "OpenGL"])
@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("case", CASES)
def test_executed_shader_gives_what_jax_gives(
    sources, tables, expected, devices, tmp_path, case, route, adapter
):
    if adapter not in devices:
        lacking(f"no wgpu, or no software adapter for {adapter} (see .ci/tools)")
    language, through_spirv = ROUTES[route]
    path = sources[case, language]
    source = path.read_text()
    if through_spirv:
        source = to_spirv(path, language).read_bytes()
    write_binary(tmp_path / "tables.bin", tables[case])
    tiles, in_jax, in_numpy = expected[case]
    data = (tmp_path / "tables.bin").read_bytes()[64:]
    got = execute(devices[adapter], source, data, tiles, REFRESH_RATES)
    np.testing.assert_allclose(got, in_jax, rtol=0, atol=1e-5)
    np.testing.assert_allclose(got, in_numpy, rtol=0, atol=1e-5)


def test_indices_beyond_the_tables_are_the_last(tables, sources, devices):
    if not devices:
        lacking("no wgpu, or no software adapter (see .ci/tools)")
    device = next(iter(devices.values()))
    tiles = drawn_tiles(2, 200)
    tiles["texture_index"], tiles["mip_level"] = 1, 2
    beyond = tiles.copy()
    beyond["texture_index"], beyond["mip_level"] = 2**32 - 1, 1e30
    data = records(tables["travel"]).padded().tobytes()
    source = sources["travel", "wgsl"].read_text()
    last, got = (execute(device, source, data, t, (60.0,)) for t in (tiles, beyond))
    np.testing.assert_array_equal(got, last)


def test_the_shader_tells_what_it_moves_to_the_edge(tables, sources, devices):
    if not devices:
        lacking("no wgpu, or no software adapter (see .ci/tools)")
    device = next(iter(devices.values()))
    tiles = drawn_tiles(2, 200)
    data = records(tables["eq31"]).padded().tobytes()
    told = "outside_domain(velocity, refresh_rate, log10_luminance)"
    source = sources["eq31", "wgsl"].read_text()
    telling = source.replace("return motion * light;", f"return f32({told});")
    assert telling != source
    got = execute(device, telling, data, tiles, REFRESH_RATES)
    fast = [np.float32(tiles[f"velocity_{axis}"] > 50) for axis in "xy"]
    assert 0 < np.sum(fast) < 400
    for refresh_rate, of_tiles in zip(REFRESH_RATES, got, strict=True):
        beyond = not 30 <= refresh_rate <= 120
        expected = np.ones(200) if beyond else np.mean(fast, axis=0)
        np.testing.assert_array_equal(of_tiles, expected[:, None].repeat(7, 1))


@pytest.mark.parametrize("language", LANGUAGES)
def test_model_stays_within_its_comment(tables, language):
    lines = shader(tables["eq31"], language).splitlines()
    (line,) = [line for line in lines if "white noise" in line]
    assert line == "// Model: white noise */ on a /"


def test_another_language_is_refused(tables):
    message = "`language` must be one of hlsl, glsl450, glsl310es, wgsl, got metal"
    with pytest.raises(ValueError, match=message):
        shader(tables["eq31"], "metal")
