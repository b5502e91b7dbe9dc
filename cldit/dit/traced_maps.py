"""Maps of a trace without noise, and the sensor whose noise they assume."""

from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluate_radiance
from cldit.dit.maps import Maps, Reason
from cldit.optics.spectral import Quadrature
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.radiance.weights import Weights
from cldit.scene import Scene


def sensor_of(
    scene: Scene, quadrature: Quadrature, seen: tuple[tuple[Weights, ...], Weights]
) -> SensorModel:
    """The scene's sensor, set so that its hottest background does not saturate it.

    `seen` are the weights of the nodes with spray, and the one without.
    """
    sensor = SensorModel.from_scene(scene)
    if scene.camera.sensor.integration_time_s is not None:
        return sensor
    surroundings = Surroundings.from_scene(scene)
    bands = [Boundary.of(surroundings, node.radiance, node.pane) for node in quadrature.nodes]
    hottest = max(scene.background.temperatures_K)
    spray, reference = seen
    images = [
        camera_radiance(weights, bands, background_K=hottest)
        for weights in (spray, [reference] * len(bands))
    ]
    return sensor.exposed_for(max(float(image.max()) for image in images))


def evaluated(
    scene: Scene,
    quadrature: Quadrature,
    spectral: tuple[Weights, ...],
    reference: Weights,
    sensor: SensorModel,
) -> Maps:
    """DIT of a trace without noise; for a single background, empty maps with the reason.

    `spectral` are the weights (H, W) of each node of `quadrature`, `reference` those without spray;
    the standard errors are those of the sensor's noise.
    """
    if len(set(scene.background.temperatures_K)) < 2:
        return Maps.unevaluated(reference.background.shape, Reason.TOO_FEW_BACKGROUNDS)
    return evaluate_radiance(
        spectral,
        reference,
        background_temperatures_K=scene.background.temperatures_K,
        surroundings=Surroundings.from_scene(scene),
        filter_um=quadrature.filter_um,
        nodes=quadrature.nodes if len(spectral) > 1 else None,
        sensor=sensor,
        shots=scene.plan.shots,
        references=scene.plan.references,
    )
