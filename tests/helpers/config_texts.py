"""A configuration in JaxPlan's format, and a section of noise to add to it."""

TEXT = """\
[Compiler]
method='DefaultJaxRDDLCompilerWithGrad'
sigmoid_weight=20

[Planner]
method='JaxDeepReactivePolicy'
method_kwargs={'topology': [8], 'activation': 'relu', 'initializer': 'normal'}
optimizer='adam'
optimizer_kwargs={'learning_rate': 0.01}
batch_size_train=4
pgpe=None

[Optimize]
key=42
epochs=300
train_seconds=60
policy_hyperparams=2.0
"""
NOISE = """
[Noise]
method='AdaptiveNoise'
sigma_max=3
alpha=0.5
"""
