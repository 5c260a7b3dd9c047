from setuptools import find_packages, setup

package_name = 'mambo_analysis'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: [
        'compare/report.css', 'compare/report.js', 'importers/estimators/*.yaml',
        'importers/maps/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The Mambo developers',
    maintainer_email='mambo@example.com',
    description='What recordings say: import, alignment, comparison, identification.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'bound = mambo_analysis.capture.recorded_bound:main',
            'compare = mambo_analysis.compare.compare:main',
            'drift_experiments = mambo_thesis.drift.experiments:main',
            'estimate = mambo_analysis.compare.estimate:main',
            'fly = mambo_flight.fly:main',
            'identify_coverage = mambo_analysis.twin.coverage:main',
            'identify_drag = mambo_analysis.identify.drag:main',
            'identify_drift = mambo_thesis.drift.identify_drift:main',
            'identify_flight = mambo_analysis.twin.identify_flight:main',
            'identify_flow = mambo_analysis.identify.flow:main',
            'identify_inertia = mambo_analysis.identify.inertia:main',
            'identify_motor = mambo_analysis.identify.motor:main',
            'identify_sensors = mambo_analysis.identify.sensors.command:main',
            'identify_thrust = mambo_analysis.identify.thrust:main',
            'import_bag = mambo_analysis.importers.any_bag:main',
            'import_crazyflie = mambo_analysis.importers.crazyflie:main',
            'import_minidrone = mambo_analysis.importers.minidrone:main',
            'import_motive = mambo_analysis.importers.motive:main',
            'import_table = mambo_analysis.importers.any_table:main',
            'join = mambo_analysis.importers.join:main',
            'recover = mambo_bags.recover:main',
            'reproduce = mambo_thesis.reproduce:main',
            'sweep = mambo_flight.sweep.command:main',
            'twin = mambo_analysis.twin.twin:main',
            'validate_recordings = mambo_thesis.recordings.validate:main',
        ],
    },
)
